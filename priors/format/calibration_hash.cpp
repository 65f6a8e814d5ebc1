// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/calibration_hash.h>
#include <kys_slam/util/hash.h>

#include <cmath>

namespace kys_slam {

std::uint64_t calibration_hash(const StereoCamera& camera) {
  Fnv1a hash;
  const auto add = [&hash](double value) {
    const auto bits = static_cast<std::uint64_t>(std::llround(value));
    for (int byte = 0; byte < 8; ++byte) {
      hash.add(static_cast<std::uint8_t>(bits >> (8 * byte)));
    }
  };
  add(camera.width);
  add(camera.height);
  for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy}) add(1e4 * value);
  add(1e7 * camera.baseline);
  return hash.value() == 0 ? 1 : hash.value();
}

}  // namespace kys_slam
