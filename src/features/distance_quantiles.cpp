// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/distance_quantiles.h>

#include <algorithm>
#include <cstddef>
#include <span>

namespace kys_slam {

namespace {

/// Value at `x` of the line through the points (xs, ys), both increasing. Beyond the ends the first
/// and last parts go on.
float along(std::span<const float> xs, std::span<const float> ys, float x) {
  const auto upper = std::upper_bound(xs.begin() + 1, xs.end() - 1, x);
  const auto i = static_cast<std::size_t>(upper - xs.begin());
  const float step = xs[i] - xs[i - 1];
  const float share = step > 0 ? (x - xs[i - 1]) / step : 0.5F;
  return ys[i - 1] + share * (ys[i] - ys[i - 1]);
}

}  // namespace

const DistanceQuantiles& orb_distances() {
  static const DistanceQuantiles orb{
      {8.38F, 10.28F, 12.73F, 17.17F, 22.14F, 33.5F, 52.61F, 79.38F, 109.09F, 124.87F, 139.91F,
       148.34F, 156.01F},
      {38.25F, 49.61F, 62.14F, 68.96F, 77.4F, 86.4F, 98.72F, 111.38F, 125.54F, 139.66F, 152.22F},
  };
  return orb;
}

float equivalent_distance(float bits, const DistanceQuantiles& extractor) {
  if (!extractor.measured()) return bits;
  const DistanceQuantiles& orb = orb_distances();
  const float same_matches = along(orb.matching, extractor.matching, bits);
  const float same_others = along(orb.other, extractor.other, bits);
  return std::clamp((same_matches + same_others) / 2, 1.0F, 256.0F);
}

}  // namespace kys_slam
