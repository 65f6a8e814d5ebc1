// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>

namespace kys_slam {

template <int Rows, int Cols>
using JacobianMap = Eigen::Map<Eigen::Matrix<double, Rows, Cols, Eigen::RowMajor>>;

/// A pose for Ceres: a unit quaternion (x, y, z, w) and a translation (m).
constexpr int kPoseSize = 7;
using PoseBlock = std::array<double, kPoseSize>;

inline PoseBlock to_block(const Rigid3& T) {
  const Eigen::Vector4d& q = T.rotation.coeffs();
  const Eigen::Vector3d& t = T.translation;
  return {q[0], q[1], q[2], q[3], t[0], t[1], t[2]};
}

inline Rigid3 to_pose(const double* block) {
  return {Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)),
          Eigen::Map<const Eigen::Vector3d>(block + 4)};
}

/// Increments of plus_left(). Costs give their derivatives by the increment in the first six
/// columns of those by the pose (set_pose_jacobian()): their product with this Jacobian is what the
/// solver needs.
class PoseManifold final : public ceres::Manifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return kPoseSize; }
  [[nodiscard]] int TangentSize() const override { return kPoseSize - 1; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const PoseBlock moved =
        to_block(plus_left(to_pose(x), Eigen::Map<const Eigen::Matrix<double, 6, 1>>(delta)));
    std::copy(moved.begin(), moved.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    JacobianMap<kPoseSize, kPoseSize - 1>{jacobian}.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 1>> delta(y_minus_x);
    delta = left_increment(to_pose(y) * to_pose(x).inverse());
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    JacobianMap<kPoseSize - 1, kPoseSize>{jacobian}.setIdentity();
    return true;
  }
};

/// Derivatives of a cost by the increment of a pose. \param jacobian of a block, or null
template <int kRows>
void set_pose_jacobian(const Eigen::Matrix<double, kRows, 6>& by_increment, double* jacobian) {
  if (jacobian == nullptr) return;
  JacobianMap<kRows, kPoseSize> J(jacobian);
  J.template leftCols<6>() = by_increment;
  J.col(kPoseSize - 1).setZero();
}

/// Derivatives of a cost whose first blocks are a pose T_c_w and a point p_w.
/// \param by_p_c those by T_c_w * p_w
template <int kRows>
void set_view_jacobians(const Eigen::Matrix<double, kRows, 3>& by_p_c, const Rigid3& T_c_w,
                        const Eigen::Vector3d& p_c, double** jacobians) {
  Eigen::Matrix<double, kRows, 6> by_increment;
  by_increment << -by_p_c * hat(p_c), by_p_c;
  set_pose_jacobian<kRows>(by_increment, jacobians[0]);
  if (jacobians[1] != nullptr) JacobianMap<kRows, 3>{jacobians[1]} = by_p_c * T_c_w.R();
}

}  // namespace kys_slam
