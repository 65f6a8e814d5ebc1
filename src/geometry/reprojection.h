#pragma once

#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <cmath>

namespace kys_slam {

/// Nearer than this a point counts as behind the camera. Inverse depth goes on linearly below it
/// (value and slope continuous), so that no step of an optimiser meets an infinity or a NaN and a
/// point that strays behind the camera is pushed back in front.
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

/// False for a position that is not finite, or so far off that its square could overflow.
inline bool is_usable(const Eigen::Vector3d& p_w) {
  return (p_w.array().abs() < 1e9).all();  // false for NaN
}
/// False for a measurement that is not finite or absurd; `u_right` may be NaN (monocular).
inline bool is_usable(double u, double v, double u_right, double inv_sigma) {
  constexpr double kFarthest = 1e7;  // px
  return std::abs(u) < kFarthest && std::abs(v) < kFarthest &&
         (std::isnan(u_right) || std::abs(u_right) < kFarthest) && inv_sigma > 0 && inv_sigma < 1e6;
}

/// Predicted minus observed (u, v, disparity) of point `p_c` in the left camera frame, in px; the
/// third is meaningless for a monocular observation. The disparity, and not u_right, because its
/// error is nearly independent of that of u: stereo matching slides the patch around the left
/// keypoint, so where that lies in the world shifts both columns alike (measured on exact
/// disparities: the errors of u and u_right have a correlation of 0.95).
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
