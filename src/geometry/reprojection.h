// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <cmath>

namespace kys_slam {

/// Points nearer than this count as behind the camera. Below it inverse depth continues linearly
/// (value and slope continuous). So no step of an optimiser gives an infinity or a NaN, and a point
/// behind the camera is moved back in front of it.
inline constexpr double kMinDepth = 0.05;  // m

/// 1/z and its derivative for z >= kMinDepth, continued linearly below.
struct InverseDepth {
  double value;       ///< 1/m
  double derivative;  ///< 1/m^2

  explicit InverseDepth(double z) {
    constexpr double kTop = 1.0 / kMinDepth;
    if (z >= kMinDepth) {
      value = 1.0 / z;
      derivative = -value * value;
    } else {
      value = 2.0 * kTop - z * kTop * kTop;
      derivative = -kTop * kTop;
    }
  }
};

/// False for a position (m) that is not finite, or so far away that its square could overflow.
inline bool is_usable(const Eigen::Vector3d& p_w) {
  return (p_w.array().abs() < 1e9).all();  // false for NaN
}
/// False for a measurement that is not finite or not plausible; `u_right` may be NaN (monocular).
inline bool is_usable(double u, double v, double u_right, double inv_sigma) {
  constexpr double kFarthest = 1e7;  // px
  return std::abs(u) < kFarthest && std::abs(v) < kFarthest &&
         (std::isnan(u_right) || std::abs(u_right) < kFarthest) && inv_sigma > 0 && inv_sigma < 1e6;
}

/// Reprojection error: predicted minus observed (u, v, disparity), px, of a point `p_c` (m) in the
/// left camera frame. The third is undefined for a monocular observation. It is the disparity and
/// not u_right because the error of the disparity is nearly independent of that of u: stereo
/// matching shifts the patch around the left keypoint, so an error of u shifts both columns alike.
/// Measured on exact disparities, the errors of u and u_right have a correlation of 0.95.
inline Eigen::Vector3d reprojection_error(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                                          double u, double v, double u_right) {
  const InverseDepth inverse(p_c.z());
  const double u_predicted = camera.fx * p_c.x() * inverse.value + camera.cx;
  return {u_predicted - u, camera.fy * p_c.y() * inverse.value + camera.cy - v,
          camera.bf() * inverse.value - (u - u_right)};
}

/// Derivative of reprojection_error with respect to `p_c`, px/m.
inline Eigen::Matrix3d reprojection_jacobian(const StereoCamera& camera,
                                             const Eigen::Vector3d& p_c) {
  const InverseDepth inverse(p_c.z());
  const double fx_z = camera.fx * inverse.value;
  const double du_dz = camera.fx * p_c.x() * inverse.derivative;
  Eigen::Matrix3d J;
  J << fx_z, 0, du_dz,                                                         //
      0, camera.fy * inverse.value, camera.fy * p_c.y() * inverse.derivative,  //
      0, 0, camera.bf() * inverse.derivative;
  return J;
}

}  // namespace kys_slam
