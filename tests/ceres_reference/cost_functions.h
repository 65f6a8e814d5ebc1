// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cmath>

#include "geometry/observation.h"
#include "maps/pose_block.h"
#include "optimization/motion_term.h"

namespace kys_slam {

// Ceres residuals with analytic derivatives. Poses are blocks of pose_block.h.

/// (u, v, disparity) of a landmark, or (u, v) in the left image alone, predicted minus observed,
/// times the inverse deviations. Blocks: T_c_w, point p_w (3).
template <int kRows>
class ReprojectionCost final : public ceres::SizedCostFunction<kRows, kPoseSize, 3> {
 public:
  using Observed = Eigen::Matrix<double, kRows, 1>;  // px
  ReprojectionCost(const StereoCamera* camera, const Observed& observed, double inv_sigma,
                   const InformationRatio& ratio = {})
      : camera_(camera) {
    observed_.head<kRows>() = observed;
    const Eigen::Vector3d all(1, std::sqrt(ratio.v), std::sqrt(ratio.disparity));
    inv_sigma_ = inv_sigma * all.head<kRows>();
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const StereoCamera* camera_;
  Eigen::Vector3d observed_ = Eigen::Vector3d::Zero();
  Observed inv_sigma_;  // 1/px
};

using StereoReprojectionCost = ReprojectionCost<3>;
using MonoReprojectionCost = ReprojectionCost<2>;

/// Weighted [log of the rotation (rad); translation (m)] of T_a_b^-1 * T_w_a^-1 * T_w_b. Blocks:
/// T_w_a, T_w_b.
class RelativePoseCost final : public ceres::SizedCostFunction<6, kPoseSize, kPoseSize> {
 public:
  RelativePoseCost(const Rigid3& T_a_b, double weight) : T_a_b_(T_a_b), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Rigid3 T_a_b_;
  double weight_;
};

/// The expected motion between two poses over its deviations. Blocks: T_a_w, T_b_w.
class MotionCost final : public ceres::SizedCostFunction<6, kPoseSize, kPoseSize> {
 public:
  explicit MotionCost(const MotionTerm& motion) : motion_(motion) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  MotionTerm motion_;
};

}  // namespace kys_slam
