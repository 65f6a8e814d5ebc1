// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/util/hash.h>

#include <Eigen/Core>
#include <cstdint>

namespace kys_slam::simulator {

using kys_slam::hash_of;
using kys_slam::mix;

/// A small deterministic generator. At most one number is drawn in a full expression: compilers
/// differ in the order in which they evaluate the arguments of a call.
class Rng {
 public:
  explicit Rng(std::uint64_t seed) : state_(mix(seed)) {}

  std::uint64_t bits() {
    state_ += 0x9e3779b97f4a7c15ULL;
    return mix(state_);
  }
  /// mix() of it is what bits() gave last.
  [[nodiscard]] std::uint64_t state() const { return state_; }
  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Uniform integer in [0, n).
  int below(int n) { return static_cast<int>(bits() % static_cast<std::uint64_t>(n)); }
  bool chance(double p) { return uniform() < p; }
  /// Standard normal deviate.
  double gaussian();
  /// Three of them, of z first.
  Eigen::Vector3d gaussian3() {
    const double z = gaussian(), y = gaussian(), x = gaussian();
    return {x, y, z};
  }

 private:
  std::uint64_t state_;
};

/// Inverse of the standard normal distribution function, |error| < 1.2e-9 (Acklam).
double inverse_normal(double p);

}  // namespace kys_slam::simulator
