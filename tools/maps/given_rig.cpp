// SPDX-License-Identifier: BSD-3-Clause
#include "given_rig.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>

#include <cmath>
#include <vector>

namespace kys_slam {

std::string describe(const StereoCamera& c) {
  return fmt::format("{}x{} px, fx {:.9g}, cx {:.9g}, cy {:.9g}, baseline {:.9g} m", c.width,
                     c.height, c.fx, c.cx, c.cy, c.baseline);
}

StereoRig given_rig(const std::filesystem::path& from, double unit, const StereoCamera& camera) {
  if (from.empty()) return rig_of(camera, "output");
  StereoRig rig = read_stereo_rig(std::vector<std::filesystem::path>{from}, unit);
  rig.set_image_size(camera.width, camera.height);
  const auto rectified = rig.rectified();
  const StereoCamera theirs =
      rectified ? *rectified : StereoRectifier(rig.left, rig.right, rig.name).camera();
  constexpr double kSame = 1e-6;
  const auto differ = [](double x, double y) { return std::abs(x - y) > kSame * std::abs(y); };
  if (differ(theirs.fx, camera.fx) || differ(theirs.cx, camera.cx) ||
      differ(theirs.cy, camera.cy) || differ(theirs.baseline, camera.baseline)) {
    throw InputError(
        fmt::format("{}: not the calibration of these maps: rectified it has {}, they have {}",
                    from.string(), describe(theirs), describe(camera)));
  }
  return rig;
}

}  // namespace kys_slam
