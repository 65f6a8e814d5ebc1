// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/sensor.h"

#include <array>
#include <cmath>

#include "simulator/common/rng.h"

namespace kys_slam::simulator {

float Sensor::exposure(int frame, int camera) {
  const double drift = 0.045 * std::sin(0.061 * frame) + 0.025 * std::sin(0.173 * frame + 1.0);
  return static_cast<float>((0.97 + drift) * (camera == 0 ? 1.0 : 0.99));
}

float Sensor::vignetting(int u, int v, int width, int height) {
  const float x = (static_cast<float>(u) - 0.5F * static_cast<float>(width)) /
                  (0.5F * static_cast<float>(width));
  const float y = (static_cast<float>(v) - 0.5F * static_cast<float>(height)) /
                  (0.5F * static_cast<float>(width));
  const float r2 = x * x + y * y;
  return 1.0F - 0.16F * r2 - 0.04F * r2 * r2;
}

float Sensor::noise(int frame, int camera, int u, int v) const {
  static const std::array<float, 4096> quantiles = [] {
    std::array<float, 4096> q{};
    for (int i = 0; i < 4096; ++i) {
      q[static_cast<std::size_t>(i)] = static_cast<float>(inverse_normal((i + 0.5) / 4096));
    }
    return q;
  }();
  const std::uint64_t key = (static_cast<std::uint64_t>(frame) << 40) ^
                            (static_cast<std::uint64_t>(camera) << 36) ^
                            (static_cast<std::uint64_t>(v) << 18) ^ static_cast<std::uint64_t>(u);
  return quantiles[mix(key ^ seed) & 4095] * noise_sigma;
}

}  // namespace kys_slam::simulator
