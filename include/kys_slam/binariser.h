// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <cstdint>
#include <span>
#include <vector>

namespace kys_slam {

/// Turns float descriptors of any length D into 256 bits, by one of two codes. The same seed gives
/// the same bits on every machine: sums have a fixed order.
///
/// Signs (no period): of 256 random projections, orthogonal in groups (Ji et al., 2012: less
/// noise). The expected Hamming distance is 256 times the angle between two descriptors over pi
/// (Charikar, 2002). Needs no knowledge of the descriptors.
///
/// Circles (with a period): D orthonormal random projections, at most 256, share the bits. Each
/// runs around a circle of two periods in 2n equal steps, n being the number of its bits; one bit
/// changes at a step (Johnson's counter). The distance of two values is that of their steps along
/// the circle: up to a period it grows with their difference, and the 256 bits with the L1 distance
/// of the projected descriptors. Differences are resolved more finely than by signs, of which most
/// say little about descriptors that are near to each other.
class Binariser {
 public:
  static constexpr int kMostDimensions = 4096;

  /// \param dimensions of a descriptor, 1 to kMostDimensions
  /// \param centre subtracted from every descriptor: angles are those about it; empty: none
  /// \param period in units of the descriptors' numbers, 1e-6 to 1e6; 0: signs
  /// \throws InputError when one of them makes no sense
  explicit Binariser(int dimensions, std::uint64_t seed = 0, std::vector<float> centre = {},
                     double period = 0);

  [[nodiscard]] int dimensions() const { return dimensions_; }
  /// \param values descriptors one after the other
  /// \param bits replaced, one per descriptor
  /// \throws InputError when the number of values is not a multiple of dimensions(), or a value is
  /// not finite or above 1e30
  void apply(std::span<const float> values, std::vector<kys::Descriptor>& bits) const;

 private:
  int dimensions_;
  bool circles_;
  std::vector<float> centre_;
  std::vector<float> weights_;  // by dimension, then by bit
  std::vector<float> phases_;   // of bits, in periods; signs: 0
};

}  // namespace kys_slam
