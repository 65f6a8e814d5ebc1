// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/portable_math.h>
#include <kys_slam/rigid3.h>

/// Derivatives on SO(3), and of the increment of poses (plus_left(), rigid3.h).
///
/// Formulas: Sola, Deray and Atchuthan, "A micro Lie theory for state estimation in robotics",
/// arXiv 1812.01537, eqs. 145-146.
namespace kys_slam {

/// Left Jacobian of SO(3): exp(w + d) = exp(J_l(w) d) exp(w) to first order in d.
inline Eigen::Matrix3d so3_left_jacobian(const Eigen::Vector3d& w) {
  const double angle_sq = w.squaredNorm();
  const double angle = std::sqrt(angle_sq);
  const Eigen::Matrix3d W = hat(w);
  const bool small = angle < 1e-4;  // both series are exact to double precision here
  const double a = small ? 0.5 - angle_sq / 24.0 : (1.0 - kys::portable::cos(angle)) / angle_sq;
  const double b = small ? 1.0 / 6.0 - angle_sq / 120.0
                         : (angle - kys::portable::sin(angle)) / (angle_sq * angle);
  return Eigen::Matrix3d::Identity() + a * W + b * W * W;
}

/// Inverse of the left Jacobian, for |w| < 2 pi; the inverse right Jacobian is its transpose.
inline Eigen::Matrix3d so3_left_jacobian_inverse(const Eigen::Vector3d& w) {
  const double angle_sq = w.squaredNorm();
  const double angle = std::sqrt(angle_sq);
  const Eigen::Matrix3d W = hat(w);
  const double c = angle < 1e-3 ? 1.0 / 12.0 + angle_sq / 720.0
                                : (1.0 - 0.5 * angle / kys::portable::tan(0.5 * angle)) / angle_sq;
  return Eigen::Matrix3d::Identity() - 0.5 * W + c * W * W;
}

/// Information of an increment, the diagonal. \param sigma_rotation rad
/// \param sigma_translation m
inline Eigen::Matrix<double, 6, 1> left_information(double sigma_rotation,
                                                    double sigma_translation) {
  Eigen::Matrix<double, 6, 1> information;
  information.head<3>().setConstant(1 / (sigma_rotation * sigma_rotation));
  information.tail<3>().setConstant(1 / (sigma_translation * sigma_translation));
  return information;
}

/// A small increment of plus_left() in frame b, as one in frame a: T_a_b plus_left(I, d) T_b_a is
/// plus_left(I, adjoint(T_a_b) d) to first order.
inline Eigen::Matrix<double, 6, 6> adjoint(const Rigid3& T_a_b) {
  const Eigen::Matrix3d R = T_a_b.R();
  Eigen::Matrix<double, 6, 6> result = Eigen::Matrix<double, 6, 6>::Zero();
  result.topLeftCorner<3, 3>() = R;
  result.bottomLeftCorner<3, 3>() = hat(T_a_b.translation) * R;
  result.bottomRightCorner<3, 3>() = R;
  return result;
}

}  // namespace kys_slam
