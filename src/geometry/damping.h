// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {

/// The damping of a Levenberg-Marquardt iteration (Nielsen, "Damping Parameter in Marquardt's
/// Method", 1999): the better the predicted decrease, the less damping; successive rejected steps
/// raise it with growing factors.
class Damping {
 public:
  /// Least value of a diagonal element, for directions without observations, as in Ceres.
  static constexpr double kMinDiagonal = 1e-6;
  /// Smallest ratio of actual to predicted decrease at which a step is accepted.
  static constexpr double kMinGain = 1e-3;

  explicit Damping(double initial) : value_(initial) {}

  [[nodiscard]] double value() const { return value_; }
  /// True when the damping is so large that no step makes progress.
  [[nodiscard]] bool exhausted() const { return !(value_ < 1e16); }
  /// \param gain decrease of the cost over the predicted one
  void accept(double gain) {
    value_ *= std::max(1.0 / 3.0, 1.0 - kys::portable::power(2.0 * gain - 1.0, 3));
    growth_ = 2;
  }
  void refuse() {
    value_ *= growth_;
    growth_ *= 2;
  }

 private:
  double value_;
  double growth_ = 2;
};

}  // namespace kys_slam
