// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace kys_slam::simulator {

Texture::Texture(int side, const std::vector<float>& albedo) : side_(side) {
  std::vector<float> level = albedo;
  for (int n = side;; n /= 2) {
    offsets_.push_back(static_cast<std::uint32_t>(texels_.size()));
    for (const float a : level) {
      texels_.push_back(static_cast<std::uint8_t>(std::clamp(a, 0.0F, 1.0F) * 255.0F + 0.5F));
    }
    ++levels_;
    if (n == 1) break;
    std::vector<float> half(static_cast<std::size_t>(n / 2) * (n / 2));
    for (int y = 0; y < n / 2; ++y) {
      for (int x = 0; x < n / 2; ++x) {
        const std::size_t i = static_cast<std::size_t>(2 * y) * n + 2 * x;
        half[static_cast<std::size_t>(y) * (n / 2) + x] =
            0.25F * (level[i] + level[i + 1] + level[i + n] + level[i + n + 1]);
      }
    }
    level = std::move(half);
  }
}

float Texture::bilinear(float u, float v, int level) const {
  const int n = side_ >> level;
  const std::uint8_t* t = texels_.data() + offsets_[level];
  const float x = (u - std::floor(u)) * static_cast<float>(n) - 0.5F;
  const float y = (v - std::floor(v)) * static_cast<float>(n) - 0.5F;
  const int x_floor = static_cast<int>(x + 1.0F) - 1;  // x > -1
  const int y_floor = static_cast<int>(y + 1.0F) - 1;
  const float fx = x - static_cast<float>(x_floor);
  const float fy = y - static_cast<float>(y_floor);
  const int mask = n - 1;
  const int x0 = x_floor & mask;
  const int x1 = (x_floor + 1) & mask;
  const int r0 = (y_floor & mask) * n;
  const int r1 = ((y_floor + 1) & mask) * n;
  const float top = static_cast<float>(t[r0 + x0]) * (1 - fx) + static_cast<float>(t[r0 + x1]) * fx;
  const float low = static_cast<float>(t[r1 + x0]) * (1 - fx) + static_cast<float>(t[r1 + x1]) * fx;
  return (top * (1 - fy) + low * fy) * (1.0F / 255.0F);
}

float Texture::trilinear(float u, float v, float lod) const {
  if (lod <= 0) return bilinear(u, v, 0);
  const int level = static_cast<int>(lod);
  if (level >= levels_ - 1) return static_cast<float>(texels_.back()) * (1.0F / 255.0F);
  const float f = lod - static_cast<float>(level);
  return bilinear(u, v, level) * (1 - f) + bilinear(u, v, level + 1) * f;
}

namespace {

// log2 good to 0.01: the level of detail needs no more.
float fast_log2(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const float e = static_cast<float>(static_cast<int>(bits >> 23) - 127);
  const float m = std::bit_cast<float>((bits & 0x7fffffU) | 0x3f800000U);
  return e + (m - 1) * (1.3465F - 0.3465F * (m - 1));
}

}  // namespace

float Texture::sample(float u, float v, float du1, float dv1, float du2, float dv2,
                      int max_probes) const {
  const float n = static_cast<float>(side_);
  float major = (du1 * du1 + dv1 * dv1) * n * n;
  float minor = (du2 * du2 + dv2 * dv2) * n * n;
  float du = du1;
  float dv = dv1;
  if (minor > major) {
    std::swap(minor, major);
    du = du2;
    dv = dv2;
  }
  major = std::sqrt(major);
  minor = std::max(std::sqrt(minor), 1e-3F);
  const int probes =
      std::clamp(static_cast<int>(major / std::max(minor, 1.0F) + 0.999F), 1, max_probes);
  const float width = std::max(minor, major / static_cast<float>(probes));
  const float lod = width <= 1 ? 0 : fast_log2(width);
  if (probes == 1) return trilinear(u, v, lod);
  float sum = 0;
  const float step = 1.0F / static_cast<float>(probes);
  for (int i = 0; i < probes; ++i) {
    const float k = (static_cast<float>(i) + 0.5F) * step - 0.5F;
    sum += trilinear(u + k * du, v + k * dv, lod);
  }
  return sum * step;
}

}  // namespace kys_slam::simulator
