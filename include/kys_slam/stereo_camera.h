// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>

namespace kys_slam {

/// A rectified stereo pair: two pinhole cameras with equal intrinsics, the right one shifted along
/// +x of the left by `baseline`. Rows correspond: u_right = u_left - focal*baseline/Z.
struct StereoCamera {
  int width = 0;        ///< px
  int height = 0;       ///< px
  double fx = 0;        ///< px
  double fy = 0;        ///< px
  double cx = 0;        ///< px, integer coordinates are pixel centres
  double cy = 0;        ///< px
  double baseline = 0;  ///< m, positive

  /// fx * baseline, px·m: depth = bf / disparity.
  [[nodiscard]] double bf() const { return fx * baseline; }

  /// Left pixel (u, v), px, of a point (m) in the left camera frame. The caller checks Z > 0.
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& p_c) const {
    return {fx * p_c.x() / p_c.z() + cx, fy * p_c.y() / p_c.z() + cy};
  }
  /// (u_left, v, u_right), px, of a point (m) in the left camera frame, Z > 0.
  [[nodiscard]] Eigen::Vector3d project_stereo(const Eigen::Vector3d& p_c) const {
    const double u = fx * p_c.x() / p_c.z() + cx;
    return {u, fy * p_c.y() / p_c.z() + cy, u - bf() / p_c.z()};
  }
  /// Point (m) in the left camera frame from a left pixel (px) and its depth Z (m).
  [[nodiscard]] Eigen::Vector3d back_project(double u, double v, double depth) const {
    return {(u - cx) / fx * depth, (v - cy) / fy * depth, depth};
  }
  [[nodiscard]] bool in_image(double u, double v) const {
    return u >= 0 && v >= 0 && u <= width - 1 && v <= height - 1;
  }
  /// True when every number is finite, and sizes, focal lengths and baseline are positive.
  [[nodiscard]] bool is_valid() const {
    return width > 0 && height > 0 && std::isfinite(fx) && fx > 0 && std::isfinite(fy) && fy > 0 &&
           std::isfinite(cx) && std::isfinite(cy) && std::isfinite(baseline) && baseline > 0;
  }
  friend bool operator==(const StereoCamera&, const StereoCamera&) = default;
};

}  // namespace kys_slam
