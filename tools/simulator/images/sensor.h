// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <cstdint>

namespace kys_slam::simulator {

/// Model of the sensor: grey = blurred(tone * exposure * vignetting) + noise.
struct Sensor {
  std::uint64_t seed = 0;
  float noise_sigma = 1.5F;  ///< grey levels

  /// Exposure factor of a frame: common to both cameras, but the right one's is smaller by a share.
  [[nodiscard]] static float exposure(int frame, int camera, double difference = 0.01);
  /// Brightness factor that falls towards the corners; (u, v) px in a width x height image.
  [[nodiscard]] static float vignetting(int u, int v, int width, int height);
  /// Convolution with a Gaussian of `sigma` px; 0: none. The image goes on beyond its border with
  /// the values there.
  static void blur(ImageOf<float>& image, double sigma);
  /// Standard normal deviate of a pixel; depends only on its arguments.
  [[nodiscard]] float noise(int frame, int camera, int u, int v) const;
};

}  // namespace kys_slam::simulator
