// SPDX-License-Identifier: BSD-3-Clause
#include "features/orb_descriptor.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "features/kernels.h"
#include "features/orb_pattern.h"

namespace kys_slam {

namespace {

/// The pattern as floats, coordinates apart: all first points, then all second ones.
struct PatternPoints {
  std::array<float, 2 * kernels::kPairs> x{};
  std::array<float, 2 * kernels::kPairs> y{};

  constexpr PatternPoints() {
    for (std::size_t i = 0; i < x.size(); ++i) {
      const auto& point = kOrbPattern[i % kernels::kPairs][i / kernels::kPairs];
      x[i] = point[0];
      y[i] = point[1];
    }
  }
};
constexpr PatternPoints kPoints;

}  // namespace

float Orientation::angle() const {
  const float a = kys::portable::atan2(sine, cosine);
  const float positive = a < 0 ? a + 2 * std::numbers::pi_v<float> : a;
  return positive < 2 * std::numbers::pi_v<float> ? positive : 0;  // a tiny negative rounds up
}

Orientation orientation(const GrayImage& image, int x, int y) {
  const kernels::Moments m = kernels::kernels().moments(image.row(y) + x, image.width());
  if (m.m10 == 0 && m.m01 == 0) return {};
  const double u = m.m10;
  const double v = m.m01;
  const double length = std::sqrt(u * u + v * v);
  return {static_cast<float>(u / length), static_cast<float>(v / length)};
}

kys::Descriptor orb_descriptor(const GrayImage& blurred, int x, int y, const Orientation& turn) {
  kys::Descriptor descriptor;
  kernels::kernels().describe(blurred.row(y) + x, blurred.width(), kPoints.x.data(),
                              kPoints.y.data(), turn.cosine, turn.sine, descriptor.words.data());
  return descriptor;
}

void DescriptorBlur::apply(const GrayImage& image, GrayImage& blurred) {
  if (blurred.width() != image.width() || blurred.height() != image.height()) {
    blurred = GrayImage(image.width(), image.height());
  }
  if (image.empty()) return;
  column_.resize(static_cast<std::size_t>(image.width()) + 6);
  const auto blur_row = kernels::kernels().blur_row;
  for (int y = 0; y < image.height(); ++y) {
    std::array<const std::uint8_t*, 7> rows{};
    for (int k = 0; k < 7; ++k) {
      rows[static_cast<std::size_t>(k)] = image.row(std::clamp(y + k - 3, 0, image.height() - 1));
    }
    blur_row(rows.data(), image.width(), column_.data(), blurred.row(y));
  }
}

}  // namespace kys_slam
