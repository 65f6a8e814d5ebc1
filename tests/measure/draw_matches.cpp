// SPDX-License-Identifier: BSD-3-Clause
#include "measure/draw_matches.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kys_slam {

namespace {

void draw_line(RgbImage& image, float x0, float y0, float x1, float y1, const RgbPixel& colour) {
  const int steps = std::max(1, static_cast<int>(std::hypot(x1 - x0, y1 - y0)));
  for (int i = 0; i <= steps; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(steps);
    const int x = static_cast<int>(std::lround(x0 + t * (x1 - x0)));
    const int y = static_cast<int>(std::lround(y0 + t * (y1 - y0)));
    if (image.contains(x, y)) image.at(x, y) = colour;
  }
}

}  // namespace

RgbImage draw_matches(const GrayImage& left, const GrayImage& right,
                      std::span<const std::pair<Keypoint, Keypoint>> matches) {
  static constexpr std::array<RgbPixel, 6> kColours{
      {{255, 80, 80}, {80, 255, 80}, {80, 160, 255}, {255, 220, 0}, {255, 80, 255}, {0, 255, 255}}};
  RgbImage both(left.width() + right.width(), std::max(left.height(), right.height()));
  const auto paste = [&](const GrayImage& image, int column) {
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) both.at(column + x, y).fill(image.at(x, y));
    }
  };
  paste(left, 0);
  paste(right, left.width());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const auto& [a, b] = matches[i];
    draw_line(both, a.x, a.y, b.x + static_cast<float>(left.width()), b.y,
              kColours[i % kColours.size()]);
  }
  return both;
}

}  // namespace kys_slam
