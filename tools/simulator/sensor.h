#pragma once

#include <cstdint>

namespace kys_slam::simulator {

/// What the sensor makes of the light that reaches it: grey = tone * exposure * vignetting + noise.
struct Sensor {
  std::uint64_t seed = 0;
  float noise_sigma = 1.5F;  ///< grey levels

  /// Brightness drift of a frame (both cameras, and one per cent between them).
  [[nodiscard]] static float exposure(int frame, int camera);
  /// Loss towards the corners; (u, v) px in a width x height image.
  [[nodiscard]] static float vignetting(int u, int v, int width, int height);
  /// Standard normal deviate of a pixel: depends on nothing but its arguments.
  [[nodiscard]] float noise(int frame, int camera, int u, int v) const;
};

}  // namespace kys_slam::simulator
