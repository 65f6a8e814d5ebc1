// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace kys_slam::simulator {

/// Model of the sensor: grey = tone * exposure * vignetting + noise.
struct Sensor {
  std::uint64_t seed = 0;
  float noise_sigma = 1.5F;  ///< grey levels

  /// Exposure factor of a frame: common to both cameras, with 1 % between them.
  [[nodiscard]] static float exposure(int frame, int camera);
  /// Brightness factor that falls towards the corners; (u, v) px in a width x height image.
  [[nodiscard]] static float vignetting(int u, int v, int width, int height);
  /// Standard normal deviate of a pixel; depends only on its arguments.
  [[nodiscard]] float noise(int frame, int camera, int u, int v) const;
};

}  // namespace kys_slam::simulator
