// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>

#include "geometry/levenberg.h"
#include "geometry/so3.h"

namespace kys_slam {

/// Normal equations of a least-squares problem at a pose T_a_b, over the increment of plus_left().
struct PoseNormalEquations {
  Eigen::Matrix<double, 6, 6> hessian;   ///< J^T W J
  Eigen::Matrix<double, 6, 1> gradient;  ///< J^T W r
  double cost = 0;
};

struct PoseMinimisation {
  int iterations = 10;
  double damping = 1e-6;         ///< of the first step, relative to the diagonal of the Hessian
  double cost_tolerance = 1e-7;  ///< stop when the relative decrease of the cost is smaller
  double step_tolerance = 1e-9;  ///< rad and m
};

/// Damping of small problems that start close: by large factors.
class PoseDamping {
 public:
  explicit PoseDamping(double initial) : value_(initial) {}

  [[nodiscard]] double value() const { return value_; }
  [[nodiscard]] static bool exhausted() { return false; }
  void accept(double /*gain*/) { value_ = std::max(value_ * 0.1, 1e-9); }
  void refuse() { value_ *= 100; }

 private:
  double value_;
};

/// One pose, for levenberg().
template <typename Linearise>
class PoseModel {
 public:
  PoseModel(const Rigid3& T_a_b, double step_tolerance, const Linearise& linearise)
      : T_(T_a_b),
        candidate_(T_a_b),
        step_tolerance_(step_tolerance),
        linearise_(linearise),
        at_(linearise(T_a_b)) {}

  [[nodiscard]] const Rigid3& pose() const { return T_; }
  [[nodiscard]] double cost() const { return at_.cost; }
  LevenbergStep step(double damping) {
    using Vector6d = Eigen::Matrix<double, 6, 1>;
    Eigen::Matrix<double, 6, 6> damped = at_.hessian;
    damped.diagonal() += damping * at_.hessian.diagonal() + Vector6d::Constant(1e-12);
    const Vector6d step = damped.ldlt().solve(-at_.gradient);
    if (!step.allFinite()) return {LevenbergStep::Outcome::kNone};
    candidate_ = plus_left(T_, step);
    const bool last = step.template lpNorm<Eigen::Infinity>() < step_tolerance_;
    return {LevenbergStep::Outcome::kTaken, LevenbergStep::kUnknown, last};
  }
  double cost_of_step() {
    next_ = linearise_(candidate_);
    return next_.cost;
  }
  void accept() {
    T_ = candidate_;
    at_ = next_;
  }
  void restore() {}

 private:
  Rigid3 T_, candidate_;
  double step_tolerance_;
  const Linearise& linearise_;
  PoseNormalEquations at_, next_;
};

/// Levenberg-Marquardt over one pose. Ceres' TinySolver is not used because it needs residuals and
/// Jacobian as matrices, while our problems accumulate their 6x6 equations directly.
/// \param linearise function from Rigid3 to PoseNormalEquations
/// \returns the pose with the least cost found
template <typename Linearise>
Rigid3 minimise_pose(const Rigid3& T_a_b, const PoseMinimisation& options,
                     const Linearise& linearise) {
  PoseModel<Linearise> model(T_a_b, options.step_tolerance, linearise);
  levenberg(model, PoseDamping(options.damping), {options.iterations, options.cost_tolerance});
  return model.pose();
}

}  // namespace kys_slam
