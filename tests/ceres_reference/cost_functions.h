// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cmath>

#include "geometry/observation.h"

namespace kys_slam {

// Ceres residuals with analytic Jacobians. A pose is a block of six: the increment [rotation (rad);
// translation (m)] of plus() from a pose the residual keeps a pointer to, so that no manifold is
// needed and no gimbal is near.

/// (u, v, disparity) of a landmark, or (u, v) in the left image alone, predicted minus observed,
/// times the inverse deviations. Blocks: increment of T_c_w (6), point p_w (3).
template <int kRows>
class ReprojectionCost final : public ceres::SizedCostFunction<kRows, 6, 3> {
 public:
  using Observed = Eigen::Matrix<double, kRows, 1>;  // px
  ReprojectionCost(const StereoCamera* camera, const Rigid3* T_c_w, const Observed& observed,
                   double inv_sigma, const InformationRatio& ratio = {})
      : camera_(camera), T_c_w_(T_c_w) {
    observed_.head<kRows>() = observed;
    const Eigen::Vector3d all(1, std::sqrt(ratio.v), std::sqrt(ratio.disparity));
    inv_sigma_ = inv_sigma * all.head<kRows>();
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const StereoCamera* camera_;
  const Rigid3* T_c_w_;
  Eigen::Vector3d observed_ = Eigen::Vector3d::Zero();
  Observed inv_sigma_;  // 1/px
};

using StereoReprojectionCost = ReprojectionCost<3>;
using MonoReprojectionCost = ReprojectionCost<2>;

/// Weighted [log of the rotation (rad); translation (m)] of T_a_b^-1 * T_w_a^-1 * T_w_b.
/// Blocks: increment of T_w_a (6), increment of T_w_b (6).
class RelativePoseCost final : public ceres::SizedCostFunction<6, 6, 6> {
 public:
  RelativePoseCost(const Rigid3* T_w_a, const Rigid3* T_w_b, const Rigid3& T_a_b, double weight)
      : T_w_a_(T_w_a), T_w_b_(T_w_b), T_a_b_(T_a_b), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Rigid3* T_w_a_;
  const Rigid3* T_w_b_;
  Rigid3 T_a_b_;
  double weight_;
};

}  // namespace kys_slam
