// SPDX-License-Identifier: BSD-3-Clause
#include "ceres_reference/cost_functions.h"

#include "geometry/reprojection.h"
#include "geometry/so3.h"

namespace kys_slam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
template <int Rows, int Cols>
using JacobianMap = Eigen::Map<Eigen::Matrix<double, Rows, Cols, Eigen::RowMajor>>;

}  // namespace

template <int kRows>
bool ReprojectionCost<kRows>::Evaluate(double const* const* parameters, double* residuals,
                                       double** jacobians) const {
  const Eigen::Map<const Eigen::Vector3d> w(parameters[0]);
  const Eigen::Map<const Eigen::Vector3d> v(parameters[0] + 3);
  const Eigen::Map<const Eigen::Vector3d> p_w(parameters[1]);
  const Eigen::Matrix3d R = (so3_exp(w) * T_c_w_->rotation).toRotationMatrix();
  const Eigen::Vector3d rotated = R * p_w;
  const Eigen::Vector3d p_c = rotated + T_c_w_->translation + v;

  Eigen::Map<Observed> residual(residuals);
  residual = inv_sigma_.cwiseProduct(
      reprojection_error(*camera_, p_c, observed_.x(), observed_.y(), observed_.z())
          .template head<kRows>());
  if (jacobians == nullptr) return true;

  const Eigen::Matrix<double, kRows, 3> J =
      inv_sigma_.asDiagonal() * reprojection_jacobian(*camera_, p_c).template topRows<kRows>();
  if (jacobians[0] != nullptr) {
    JacobianMap<kRows, 6> J_pose(jacobians[0]);
    J_pose.template leftCols<3>() = J * (-hat(rotated) * so3_left_jacobian(w));
    J_pose.template rightCols<3>() = J;
  }
  if (jacobians[1] != nullptr) {
    JacobianMap<kRows, 3> J_point(jacobians[1]);
    J_point = J * R;
  }
  return true;
}

template class ReprojectionCost<3>;
template class ReprojectionCost<2>;

bool RelativePoseCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const Vector6d delta_a = Eigen::Map<const Vector6d>(parameters[0]);
  const Vector6d delta_b = Eigen::Map<const Vector6d>(parameters[1]);
  const Rigid3 T_w_a = plus(*T_w_a_, delta_a);
  const Rigid3 T_w_b = plus(*T_w_b_, delta_b);
  const Rigid3 error = T_a_b_.inverse() * (T_w_a.inverse() * T_w_b);
  const Eigen::Vector3d rotation_error = so3_log(error.rotation);

  Eigen::Map<Vector6d> residual(residuals);
  residual << weight_ * rotation_error, weight_ * error.translation;
  if (jacobians == nullptr) return true;

  // A turn of b by exp(d) on the left is a turn of the error by exp(R_w_b^T d) on its right.
  const Eigen::Matrix3d J_right_inverse = so3_left_jacobian_inverse(rotation_error).transpose();
  const Eigen::Matrix3d J_turn = weight_ * J_right_inverse * T_w_b.R().transpose();
  const Eigen::Matrix3d R_b_w =
      weight_ * (T_w_a.rotation * T_a_b_.rotation).conjugate().toRotationMatrix();
  if (jacobians[0] != nullptr) {
    const Eigen::Matrix3d J_left = so3_left_jacobian(delta_a.head<3>());
    JacobianMap<6, 6> J(jacobians[0]);
    J.topLeftCorner<3, 3>() = -J_turn * J_left;
    J.topRightCorner<3, 3>().setZero();
    J.bottomLeftCorner<3, 3>() = R_b_w * hat(T_w_b.t() - T_w_a.t()) * J_left;
    J.bottomRightCorner<3, 3>() = -R_b_w;
  }
  if (jacobians[1] != nullptr) {
    JacobianMap<6, 6> J(jacobians[1]);
    J.topLeftCorner<3, 3>() = J_turn * so3_left_jacobian(delta_b.head<3>());
    J.topRightCorner<3, 3>().setZero();
    J.bottomLeftCorner<3, 3>().setZero();
    J.bottomRightCorner<3, 3>() = R_b_w;
  }
  return true;
}

}  // namespace kys_slam
