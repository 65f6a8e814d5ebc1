// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace kys_slam::testing {

/// The image whose pixel (x, y) has the grey level grey(x, y), rounded and kept within 0 to 255.
template <typename Grey>
GrayImage draw_image(int width, int height, Grey&& grey) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at(x, y) = static_cast<std::uint8_t>(std::clamp(std::lround(grey(x, y)), 0L, 255L));
    }
  }
  return image;
}

}  // namespace kys_slam::testing
