// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "pose_block.h"

namespace kys_slam {

/// A measured position of a keyframe's left camera, m, with its covariance, m^2. Block: its pose.
class PositionCost final : public ceres::SizedCostFunction<3, kPoseSize> {
 public:
  PositionCost(const Eigen::Vector3d& p_w, const Eigen::Matrix3d& covariance)
      : p_w_(p_w), weight_(Eigen::Matrix3d(covariance.llt().matrixL()).inverse()) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const Rigid3 T_c_w = to_pose(blocks[0]);
    Eigen::Map<Eigen::Vector3d> residual(residuals);
    residual = weight_ * (T_c_w.inverse_t() - p_w_);
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    // The centre is -R^T t; the increment x_c -> exp(w) x_c + v moves it by -R^T v.
    Eigen::Matrix<double, 3, 6> J = Eigen::Matrix<double, 3, 6>::Zero();
    J.rightCols<3>() = -weight_ * T_c_w.R().transpose();
    set_pose_jacobian<3>(J, jacobians[0]);
    return true;
  }

 private:
  Eigen::Vector3d p_w_;
  Eigen::Matrix3d weight_;
};

}  // namespace kys_slam
