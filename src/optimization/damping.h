#pragma once

#include <algorithm>
#include <cmath>

namespace kys_slam {

/// The damping of a Levenberg-Marquardt iteration (Nielsen, "Damping Parameter in Marquardt's
/// Method", 1999): the better the model held, the less damping; refused steps in a row raise it
/// ever faster.
class Damping {
 public:
  /// Added to the diagonal where a direction is not observed at all, as in Ceres.
  static constexpr double kMinDiagonal = 1e-6;
  /// Smallest share of the predicted decrease with which a step is taken.
  static constexpr double kMinGain = 1e-3;

  explicit Damping(double initial) : value_(initial) {}

  [[nodiscard]] double value() const { return value_; }
  /// No step that is still worth trying.
  [[nodiscard]] bool exhausted() const { return !(value_ < 1e16); }
  /// \param gain decrease of the cost over the predicted one
  void accept(double gain) {
    value_ *= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3));
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
