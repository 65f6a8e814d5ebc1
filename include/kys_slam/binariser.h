// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <cstdint>
#include <span>
#include <vector>

namespace kys_slam {

/// Turns float descriptors of any length into 256 bits: the signs of 256 random projections, which
/// are orthogonal in groups (Ji et al., 2012: less noise). The expected Hamming distance of two
/// descriptors is 256 times the angle between them over pi (Charikar, 2002), so that `kys` scales
/// it as that of ORB. The same seed gives the same bits on every machine: sums have a fixed order.
class Binariser {
 public:
  static constexpr int kMostDimensions = 4096;

  /// \param dimensions of a descriptor, 1 to kMostDimensions
  /// \param centre subtracted from every descriptor: angles are those about it; empty: none
  /// \throws InputError when one of them makes no sense
  explicit Binariser(int dimensions, std::uint64_t seed = 0, std::vector<float> centre = {});

  [[nodiscard]] int dimensions() const { return dimensions_; }
  /// \param values descriptors one after the other
  /// \param bits replaced, one per descriptor
  /// \throws InputError when the number of values is not a multiple of dimensions(), or a value is
  /// not finite or above 1e30
  void apply(std::span<const float> values, std::vector<kys::Descriptor>& bits) const;

 private:
  int dimensions_;
  std::vector<float> centre_;
  std::vector<float> weights_;  // by dimension, then by bit
};

}  // namespace kys_slam
