// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "simulator/common/rng.h"

namespace kys_slam::simulator {

float Sensor::exposure(int frame, int camera, double difference) {
  const double drift = 0.045 * std::sin(0.061 * frame) + 0.025 * std::sin(0.173 * frame + 1.0);
  return static_cast<float>((0.97 + drift) * (camera == 0 ? 1.0 : 1.0 - difference));
}

float Sensor::vignetting(int u, int v, int width, int height) {
  const float x = (static_cast<float>(u) - 0.5F * static_cast<float>(width)) /
                  (0.5F * static_cast<float>(width));
  const float y = (static_cast<float>(v) - 0.5F * static_cast<float>(height)) /
                  (0.5F * static_cast<float>(width));
  const float r2 = x * x + y * y;
  return 1.0F - 0.16F * r2 - 0.04F * r2 * r2;
}

namespace {

/// Half of a symmetric kernel, from its middle, with sum 1.
std::vector<float> gaussian_kernel(double sigma) {
  const int radius = static_cast<int>(std::ceil(4 * sigma));
  std::vector<double> k;
  double sum = 0;
  for (int i = 0; i <= radius; ++i) {
    k.push_back(std::exp(-0.5 * i * i / (sigma * sigma)));
    sum += (i == 0 ? 1 : 2) * k.back();
  }
  std::vector<float> kernel;
  for (const double x : k) kernel.push_back(static_cast<float>(x / sum));
  return kernel;
}

/// One row or column of `count` values, `step` apart.
void convolve(float* line, int count, std::ptrdiff_t step, const std::vector<float>& kernel) {
  std::vector<float> before(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) before[static_cast<std::size_t>(i)] = line[i * step];
  const auto at = [&](int i) {
    return before[static_cast<std::size_t>(std::clamp(i, 0, count - 1))];
  };
  for (int i = 0; i < count; ++i) {
    float sum = kernel[0] * at(i);
    for (int k = 1; k < static_cast<int>(kernel.size()); ++k) {
      sum += kernel[static_cast<std::size_t>(k)] * (at(i - k) + at(i + k));
    }
    line[i * step] = sum;
  }
}

}  // namespace

void Sensor::blur(ImageOf<float>& image, double sigma) {
  if (sigma == 0) return;
  const std::vector<float> kernel = gaussian_kernel(sigma);
  for (int v = 0; v < image.height(); ++v) convolve(&image.at(0, v), image.width(), 1, kernel);
  for (int u = 0; u < image.width(); ++u) {
    convolve(&image.at(u, 0), image.height(), image.width(), kernel);
  }
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
