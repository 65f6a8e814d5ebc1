// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <vector>

namespace kys_slam {

/// Shares at which distances of pairs that show the same point are given.
inline constexpr std::array<double, 13> kMatchingShares{0.005, 0.01, 0.02, 0.05, 0.1,  0.25, 0.5,
                                                        0.75,  0.9,  0.95, 0.98, 0.99, 0.995};
/// The same for pairs that show different points.
inline constexpr std::array<double, 11> kOtherShares{1e-5, 1e-4, 1e-3, 3e-3, 0.01, 0.03,
                                                     0.1,  0.25, 0.5,  0.75, 0.9};

/// Hamming distances (bits) of an extractor: the share of pairs with at most this distance is
/// kMatchingShares, kOtherShares. Both increase; both empty: not measured.
struct DistanceQuantiles {
  std::vector<float> matching;
  std::vector<float> other;

  [[nodiscard]] bool measured() const { return !matching.empty(); }
};

/// Of ORB with the default settings, measured on 40 frames of a street (KITTI raw 2011_09_26 drive
/// 0005) by `kys-slam features`.
const DistanceQuantiles& orb_distances();

/// The distance that is as strict for an extractor as `bits` is for ORB: the mean of the one that
/// accepts the same share of matching pairs and of the one that accepts the same share of others.
/// Increases with `bits`; 1 to 256. Not measured: `bits`.
float equivalent_distance(float bits, const DistanceQuantiles& extractor);

}  // namespace kys_slam
