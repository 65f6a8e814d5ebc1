#include <kys_slam/error.h>

#include <algorithm>

#include "world.h"

namespace kys_slam::simulator {
namespace {

int edit_distance(const std::string& a, const std::string& b) {
  std::vector<int> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = static_cast<int>(j);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const int keep = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({keep, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

constexpr int kKittiWidth = 1241;
constexpr int kKittiHeight = 376;
constexpr int kMaxFrames = 600;

}  // namespace

const std::vector<std::string>& world_names() {
  static const std::vector<std::string> names = {"street", "traffic", "jam", "block", "hall"};
  return names;
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
  world.rig.left = CameraModel::pinhole(width, height, c.fx, c.fy, c.cx, c.cy);
  world.rig.right = world.rig.left;
  world.rig.T_left_right = Rigid3(Eigen::Quaterniond::Identity(), Vec3(c.baseline, 0, 0));
  world.truth_rig = world.rig;
  world.layout = Layout::kKitti;
}

World make_world(const WorldOptions& options) {
  const auto& names = world_names();
  if (std::find(names.begin(), names.end(), options.name) == names.end()) {
    const auto nearest = *std::min_element(
        names.begin(), names.end(), [&](const std::string& a, const std::string& b) {
          return edit_distance(a, options.name) < edit_distance(b, options.name);
        });
    throw InputError("unknown world '" + options.name + "': did you mean '" + nearest +
                     "'? (worlds: street, traffic, jam, block, hall)");
  }
  const bool sized = options.width != 0 || options.height != 0;
  if (sized && (options.width < 64 || options.height < 48 || options.width > 8192 ||
                options.height > 8192)) {
    throw InputError("--size " + std::to_string(options.width) + "x" +
                     std::to_string(options.height) + ": must lie between 64x48 and 8192x8192");
  }
  if (options.frames < 0 || options.frames > kMaxFrames) {
    throw InputError("--frames " + std::to_string(options.frames) + ": must lie between 1 and " +
                     std::to_string(kMaxFrames));
  }
  World world = options.name == "street"    ? make_street(options)
                : options.name == "traffic" ? make_traffic(options)
                : options.name == "jam"     ? make_jam(options)
                : options.name == "block"   ? make_block(options)
                                            : make_hall(options);
  if (world.T_w_truth.empty()) world.T_w_truth = world.T_w_c;
  return world;
}

}  // namespace kys_slam::simulator
