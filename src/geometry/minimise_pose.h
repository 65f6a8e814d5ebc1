// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>

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

/// Levenberg-Marquardt over one pose. Ceres' TinySolver is not used because it needs residuals and
/// Jacobian as matrices, while our problems accumulate their 6x6 equations directly.
/// \param linearise function from Rigid3 to PoseNormalEquations
/// \returns the pose with the least cost found
template <typename Linearise>
Rigid3 minimise_pose(Rigid3 T_a_b, const PoseMinimisation& options, const Linearise& linearise) {
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  PoseNormalEquations best = linearise(T_a_b);
  double damping = options.damping;
  for (int i = 0; i < options.iterations; ++i) {
    Eigen::Matrix<double, 6, 6> damped = best.hessian;
    damped.diagonal() += damping * best.hessian.diagonal() + Vector6d::Constant(1e-12);
    const Vector6d step = damped.ldlt().solve(-best.gradient);
    if (!step.allFinite()) break;
    const bool tiny = step.lpNorm<Eigen::Infinity>() < options.step_tolerance;
    const Rigid3 candidate = plus_left(T_a_b, step);
    const PoseNormalEquations next = linearise(candidate);
    if (next.cost <= best.cost) {
      const double decrease = best.cost - next.cost;
      const bool converged = tiny || decrease <= options.cost_tolerance * best.cost;
      T_a_b = candidate;
      best = next;
      damping = std::max(damping * 0.1, 1e-9);
      if (converged) break;
    } else {
      if (tiny) break;
      damping *= 100;
    }
  }
  return T_a_b;
}

}  // namespace kys_slam
