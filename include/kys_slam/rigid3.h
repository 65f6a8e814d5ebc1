// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/portable_math.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace kys_slam {

/// A rigid transformation, SE(3). `Rigid3 T_a_b` maps coordinates in frame b to frame a:
///   p_a = T_a_b * p_b,   T_a_c = T_a_b * T_b_c,   T_b_a = T_a_b.inverse().
/// Frames: w world, c left camera (x right, y down, z forward), r right camera, b body.
/// Lengths are in m. The rotation is stored as a unit quaternion.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3() = default;
  Rigid3(const Eigen::Quaterniond& q, const Eigen::Vector3d& t)
      : rotation(q.normalized()), translation(t) {}
  Rigid3(const Eigen::Matrix3d& R, const Eigen::Vector3d& t)
      : rotation(Eigen::Quaterniond(R).normalized()), translation(t) {}

  [[nodiscard]] Eigen::Matrix3d R() const { return rotation.toRotationMatrix(); }
  [[nodiscard]] const Eigen::Vector3d& t() const { return translation; }

  [[nodiscard]] Rigid3 inverse() const {
    const Eigen::Quaterniond q = rotation.conjugate();
    return {q, -(q * translation)};
  }
  /// Translation of the inverse: for T_c_w the camera's centre in the world.
  [[nodiscard]] Eigen::Vector3d inverse_t() const { return rotation.conjugate() * -translation; }
  /// The 3x4 matrix [R|t].
  [[nodiscard]] Eigen::Matrix<double, 3, 4> matrix() const {
    Eigen::Matrix<double, 3, 4> M;
    M << R(), translation;
    return M;
  }
  [[nodiscard]] bool is_finite() const {
    return rotation.coeffs().allFinite() && translation.allFinite();
  }
};

inline Rigid3 operator*(const Rigid3& T_a_b, const Rigid3& T_b_c) {
  return {T_a_b.rotation * T_b_c.rotation, T_a_b.rotation * T_b_c.translation + T_a_b.translation};
}
inline Eigen::Vector3d operator*(const Rigid3& T_a_b, const Eigen::Vector3d& p_b) {
  return T_a_b.rotation * p_b + T_a_b.translation;
}

/// The same rotation, the translation times `factor`.
inline Rigid3 scaled(Rigid3 T_a_b, double factor) {
  T_a_b.translation *= factor;
  return T_a_b;
}

/// Skew-symmetric matrix: hat(a) * b == a.cross(b).
inline Eigen::Matrix3d hat(const Eigen::Vector3d& a) {
  Eigen::Matrix3d A;
  A << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return A;
}

/// Rotation vector (rad) to unit quaternion.
inline Eigen::Quaterniond so3_exp(const Eigen::Vector3d& w) {
  const double angle_sq = w.squaredNorm();
  const double angle = std::sqrt(angle_sq);
  const double k = angle < 1e-6 ? 0.5 - angle_sq / 48.0 : kys::portable::sin(0.5 * angle) / angle;
  const double c = angle < 1e-6 ? 1.0 - angle_sq / 8.0 : kys::portable::cos(0.5 * angle);
  return Eigen::Quaterniond(c, k * w.x(), k * w.y(), k * w.z()).normalized();
}

/// Unit quaternion to rotation vector (rad), norm in [0, pi].
inline Eigen::Vector3d so3_log(const Eigen::Quaterniond& q_in) {
  const Eigen::Quaterniond q = q_in.w() < 0 ? Eigen::Quaterniond(-q_in.coeffs()) : q_in;
  const double n = q.vec().norm();
  if (n < 1e-9) return 2.0 * q.vec();
  return 2.0 * kys::portable::atan2(n, q.w()) / n * q.vec();
}

/// The increment of a pose, [w; v] (rad, m), rotation first, on the left:
///   plus_left(T_a_b, [w; v]): p_a -> exp(w) p_a + v.
/// The derivative of a point in frame a is [-hat(p_a), I], independent of T_a_b. Solvers,
/// adjustments of maps and covariances use it, but for plus() below.
inline Rigid3 plus_left(const Rigid3& T_a_b, const Eigen::Matrix<double, 6, 1>& delta) {
  const Eigen::Quaterniond turn = so3_exp(delta.head<3>());
  return {turn * T_a_b.rotation, turn * T_a_b.translation + delta.tail<3>()};
}

/// The increment of plus_left() from the identity to T.
inline Eigen::Matrix<double, 6, 1> left_increment(const Rigid3& T) {
  Eigen::Matrix<double, 6, 1> delta;
  delta << so3_log(T.rotation), T.translation;
  return delta;
}

/// Rotation and translation apart, of places far from the origin (pose graph, whose damping acts on
/// translations), of the ego-motion of the prior builder, and of covariances of tracked poses:
///   plus(T, [w; v]) = { exp(w) * R, t + v },   minus(A, B) = [log(R_A R_B^-1); t_A - t_B].
/// From T = I it is plus_left(); to first order v_left = v + hat(t) w.
inline Rigid3 plus(const Rigid3& T, const Eigen::Matrix<double, 6, 1>& delta) {
  return {so3_exp(delta.head<3>()) * T.rotation, T.translation + delta.tail<3>()};
}
inline Eigen::Matrix<double, 6, 1> minus(const Rigid3& A, const Rigid3& B) {
  Eigen::Matrix<double, 6, 1> delta;
  delta << so3_log(A.rotation * B.rotation.conjugate()), A.translation - B.translation;
  return delta;
}

/// Distance of two camera centres, m, from poses of the same world.
inline double centre_distance(const Rigid3& T_a_w, const Rigid3& T_b_w) {
  return (T_a_w.inverse_t() - T_b_w.inverse_t()).norm();
}

/// Angle of the rotation, rad.
inline double rotation_angle(const Rigid3& T) {
  return so3_log(T.rotation).norm();
}

}  // namespace kys_slam
