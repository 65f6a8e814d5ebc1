// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

namespace kys_slam::test {

/// Every pixel drawn on its own.
inline GrayImage noise_image(int width, int height, std::uint32_t seed, int levels = 256) {
  GrayImage image(width, height);
  std::mt19937 random(seed);
  for (std::size_t i = 0; i < image.size(); ++i) {
    image.data()[i] = static_cast<std::uint8_t>(random() % static_cast<unsigned>(levels));
  }
  return image;
}

/// A texture defined on the whole plane, so that it can be rendered under any map: overlapping
/// squares of many sizes (the occlusion model behind the statistics of natural images), the nearest
/// square that covers a point giving its grey level.
class Texture {
 public:
  explicit Texture(std::uint32_t seed) : seed_(seed) {}

  [[nodiscard]] double operator()(double x, double y) const {
    for (int layer = 0; layer < 6; ++layer) {
      const double size = 6.0 * std::pow(1.7, layer);
      const auto i = static_cast<std::int64_t>(std::floor(x / size));
      const auto j = static_cast<std::int64_t>(std::floor(y / size));
      const std::uint32_t h = hash(i, j, layer);
      const double cx = (static_cast<double>(i) + 0.3 + 0.4 * (h & 255) / 255.0) * size;
      const double cy = (static_cast<double>(j) + 0.3 + 0.4 * ((h >> 8) & 255) / 255.0) * size;
      const double half = size * 0.28;
      if ((h >> 24) % 3 == 0 && std::abs(x - cx) < half && std::abs(y - cy) < half) {
        return (h >> 16) & 255;
      }
    }
    return 110;
  }

  /// Renders with `map(x, y)` giving the texture coordinates of an image point; nine samples a
  /// pixel.
  template <typename Map>
  [[nodiscard]] GrayImage render(int width, int height, const Map& map) const {
    GrayImage image(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        double sum = 0;
        for (int k = 0; k < 9; ++k) {
          const auto at = map(x + (k % 3 - 1) / 3.0, y + (k / 3 - 1) / 3.0);
          sum += (*this)(at.first, at.second);
        }
        image.at(x, y) = static_cast<std::uint8_t>(std::lround(sum / 9));
      }
    }
    return image;
  }

  [[nodiscard]] GrayImage render(int width, int height) const {
    return render(width, height, [](double x, double y) { return std::pair(x, y); });
  }

 private:
  [[nodiscard]] std::uint32_t hash(std::int64_t i, std::int64_t j, int layer) const {
    auto h = static_cast<std::uint64_t>(i) * 0x9E3779B97F4A7C15ull ^
             static_cast<std::uint64_t>(j) * 0xC2B2AE3D27D4EB4Full ^
             (static_cast<std::uint64_t>(layer) << 32) ^ seed_;
    h ^= h >> 31;
    h *= 0xD6E8FEB86659FD93ull;
    h ^= h >> 32;
    return static_cast<std::uint32_t>(h);
  }

  std::uint32_t seed_;
};

}  // namespace kys_slam::test
