// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/util/nearest_name.h>

#include <algorithm>

#include "simulator/worlds/world.h"

namespace kys_slam::simulator {
namespace {

constexpr int kKittiWidth = 1241;
constexpr int kKittiHeight = 376;
constexpr int kMaxFrames = 600;

}  // namespace

const std::vector<std::string>& world_names() {
  static const std::vector<std::string> names = {"street", "traffic", "jam", "block", "hall"};
  return names;
}

void describe(kys::OptionList& list, WorldOptions& o) {
  list.add("--frames", o.frames, {0, kMaxFrames});
  list.add("--size width", o.width, {0, 8192}, "px");
  list.add("--size height", o.height, {0, 8192}, "px");
  list.add("--blur left", o.blur[0], {0, 20}, "px");
  list.add("--blur right", o.blur[1], {0, 20}, "px");
  list.add("--exposure-difference", o.exposure_difference, {-0.9, 0.9});
  const bool sized = o.width != 0 || o.height != 0;
  list.require(!sized || (o.width >= 64 && o.height >= 48),
               "--size must be between 64x48 and 8192x8192");
}

void set_kitti_rig(World& world, const WorldOptions& options) {
  const int width = options.width > 0 ? options.width : kKittiWidth;
  const int height = options.height > 0 ? options.height : kKittiHeight;
  const double sx = static_cast<double>(width) / kKittiWidth;
  const double sy = static_cast<double>(height) / kKittiHeight;
  StereoCamera& c = world.rectified;
  c.width = width;
  c.height = height;
  c.fx = c.fy = 718.856 * sx;
  c.cx = (607.1928 + 0.5) * sx - 0.5;
  c.cy = (185.2157 + 0.5) * sy - 0.5;
  c.baseline = 386.1448 / 718.856;
  world.rig.left = pinhole(c);
  world.rig.right = world.rig.left;
  world.rig.T_left_right = Rigid3(Eigen::Quaterniond::Identity(), Vec3(c.baseline, 0, 0));
  world.truth_rig = world.rig;
  world.layout = Layout::kKitti;
}

World make_world(const WorldOptions& options) {
  const auto& names = world_names();
  if (std::find(names.begin(), names.end(), options.name) == names.end()) {
    throw InputError("unknown world '" + options.name + "'" + did_you_mean(options.name, names) +
                     " (worlds: street, traffic, jam, block, hall)");
  }
  check_options(options);
  World world = options.name == "street"    ? make_street(options)
                : options.name == "traffic" ? make_traffic(options)
                : options.name == "jam"     ? make_jam(options)
                : options.name == "block"   ? make_block(options)
                                            : make_hall(options);
  world.blur = options.blur;
  world.exposure_difference = options.exposure_difference;
  if (world.T_w_truth.empty()) world.T_w_truth = world.T_w_c;
  return world;
}

}  // namespace kys_slam::simulator
