// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

namespace kys_slam::simulator {

/// Pinhole with Brown-Conrady distortion in OpenCV's order and meaning (k1, k2, p1, p2), inverted
/// by iteration.
struct Lens {
  double f_x = 1, f_y = 1;             ///< px
  double c_x = 0, c_y = 0;             ///< px
  std::array<double, 4> distortion{};  ///< ideal to distorted, of directions (x, y, 1)

  /// Direction (x, y, 1) through the pixel (u, v).
  [[nodiscard]] Eigen::Vector2d ray(double u, double v) const;
  /// Pixel of a direction.
  [[nodiscard]] Eigen::Vector2d project(double x, double y) const;
  /// True when every pixel of an image of this size (px) has one direction: strong distortion folds
  /// the image.
  [[nodiscard]] bool is_invertible(int width, int height) const;
};

}  // namespace kys_slam::simulator
