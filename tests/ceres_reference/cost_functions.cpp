// SPDX-License-Identifier: BSD-3-Clause
#include "ceres_reference/cost_functions.h"

#include "geometry/reprojection.h"
#include "geometry/so3.h"

namespace kys_slam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

}  // namespace

template <int kRows>
bool ReprojectionCost<kRows>::Evaluate(double const* const* parameters, double* residuals,
                                       double** jacobians) const {
  const Rigid3 T_c_w = to_pose(parameters[0]);
  const Eigen::Vector3d p_c = T_c_w * Eigen::Map<const Eigen::Vector3d>(parameters[1]);
  Eigen::Map<Observed> residual(residuals);
  residual = inv_sigma_.cwiseProduct(
      reprojection_error(*camera_, p_c, observed_.x(), observed_.y(), observed_.z())
          .template head<kRows>());
  if (jacobians == nullptr) return true;
  const Eigen::Matrix<double, kRows, 3> J =
      inv_sigma_.asDiagonal() * reprojection_jacobian(*camera_, p_c).template topRows<kRows>();
  set_view_jacobians<kRows>(J, T_c_w, p_c, jacobians);
  return true;
}

template class ReprojectionCost<3>;
template class ReprojectionCost<2>;

bool RelativePoseCost::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const Rigid3 T_w_a = to_pose(parameters[0]), T_w_b = to_pose(parameters[1]);
  const Rigid3 error = T_a_b_.inverse() * (T_w_a.inverse() * T_w_b);
  const Eigen::Vector3d rotation_error = so3_log(error.rotation);
  Eigen::Map<Vector6d> residual(residuals);
  residual << weight_ * rotation_error, weight_ * error.translation;
  if (jacobians == nullptr) return true;
  // A turn of b by exp(w) on the left is a turn of the error by exp(R_w_b^T w) on its right. The
  // same increment of a and b changes nothing.
  const Eigen::Matrix3d J_right_inverse = so3_left_jacobian_inverse(rotation_error).transpose();
  const Eigen::Matrix3d R_b_w = (T_w_a.rotation * T_a_b_.rotation).conjugate().toRotationMatrix();
  Matrix6d J;
  J << J_right_inverse * T_w_b.R().transpose(), Eigen::Matrix3d::Zero(), -R_b_w * hat(T_w_b.t()),
      R_b_w;
  set_pose_jacobian<6>(-weight_ * J, jacobians[0]);
  set_pose_jacobian<6>(weight_ * J, jacobians[1]);
  return true;
}

bool MotionCost::Evaluate(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  const Rigid3 T_a_b = to_pose(parameters[0]) * to_pose(parameters[1]).inverse();
  const Rigid3 more = T_a_b * motion_.T_a_b.inverse();
  const Eigen::Vector3d turn = so3_log(more.rotation);
  Vector6d weight;
  weight << Eigen::Vector3d::Constant(1 / motion_.sigma_rotation),
      Eigen::Vector3d::Constant(1 / motion_.sigma_position);
  Eigen::Map<Vector6d> residual(residuals);
  residual << turn, more.translation;
  residual = residual.cwiseProduct(weight).eval();
  if (jacobians == nullptr) return true;
  Matrix6d J;  // an increment of a is one of `more`
  J << so3_left_jacobian_inverse(turn), Eigen::Matrix3d::Zero(), -hat(more.translation),
      Eigen::Matrix3d::Identity();
  J = weight.asDiagonal() * J;
  set_pose_jacobian<6>(J, jacobians[0]);
  set_pose_jacobian<6>(-J * adjoint(T_a_b), jacobians[1]);
  return true;
}

}  // namespace kys_slam
