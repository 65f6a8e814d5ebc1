#include <kys_slam/calibration_hash.h>

#include <cmath>

namespace kys_slam {

std::uint64_t calibration_hash(const StereoCamera& camera) {
  std::uint64_t hash = 0xCBF29CE484222325ull;
  const auto add = [&hash](double value) {
    const auto bits = static_cast<std::uint64_t>(std::llround(value));
    for (int byte = 0; byte < 8; ++byte) {
      hash = (hash ^ ((bits >> (8 * byte)) & 0xFF)) * 0x100000001B3ull;
    }
  };
  add(camera.width);
  add(camera.height);
  for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy}) add(1e4 * value);
  add(1e7 * camera.baseline);
  return hash == 0 ? 1 : hash;
}

}  // namespace kys_slam
