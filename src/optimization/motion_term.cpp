// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/motion_term.h"

#include "geometry/so3.h"

namespace kys_slam {

namespace {

using Matrix6d = MotionNormal::Matrix6d;
using Vector6d = MotionNormal::Vector6d;

/// What the motion is more than the expected one, in the frame of pose a.
Rigid3 surplus(const MotionTerm& term, const Rigid3& T_a_b) {
  return T_a_b * term.T_a_b.inverse();
}

Vector6d information_of(const MotionTerm& term) {
  return left_information(term.sigma_rotation, term.sigma_position);
}

}  // namespace

double cost_of(const MotionTerm& term, const Rigid3& T_a_w, const Rigid3& T_b_w) {
  const Vector6d error = left_increment(surplus(term, T_a_w * T_b_w.inverse()));
  return 0.5 * information_of(term).dot(error.cwiseAbs2());
}

MotionNormal normal_of(const MotionTerm& term, const Rigid3& T_a_w, const Rigid3& T_b_w) {
  const Rigid3 T_a_b = T_a_w * T_b_w.inverse();
  const Rigid3 more = surplus(term, T_a_b);
  // The surplus turns by a small angle: its logarithm moves as the increment of a does.
  Matrix6d J_a = Matrix6d::Identity();
  J_a.bottomLeftCorner<3, 3>() = -hat(more.translation);
  // An increment of b is one of a, expressed in its frame, the other way round.
  const Matrix6d J_b = -J_a * adjoint(T_a_b);
  const Vector6d information = information_of(term);
  const Vector6d weighted = information.cwiseProduct(left_increment(more));
  const Matrix6d WJ_a = information.asDiagonal() * J_a;
  const Matrix6d WJ_b = information.asDiagonal() * J_b;
  MotionNormal normal;
  normal.aa = J_a.transpose() * WJ_a;
  normal.ab = J_a.transpose() * WJ_b;
  normal.bb = J_b.transpose() * WJ_b;
  normal.a = J_a.transpose() * weighted;
  normal.b = J_b.transpose() * weighted;
  return normal;
}

}  // namespace kys_slam
