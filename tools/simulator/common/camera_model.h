// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <vector>

namespace kys_slam::simulator {

/// One camera's geometry as viewing rays: for each pixel the direction (x, y, 1) in the camera
/// frame (x right, y down, z forward) and its change per pixel.
class CameraModel {
 public:
  CameraModel() = default;
  static CameraModel pinhole(int width, int height, double f_x, double f_y, double c_x, double c_y);
  /// Pinhole with radial-tangential distortion (k1, k2, p1, p2), inverted by iteration.
  static CameraModel radtan(int width, int height, double f_x, double f_y, double c_x, double c_y,
                            const std::array<double, 4>& distortion);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// Direction through (u, v) px; fractions are measured from the nearest pixel's centre.
  [[nodiscard]] Eigen::Vector2d ray(double u, double v) const;
  struct Ray {
    float x, y;      ///< direction (x, y, 1)
    float x_u, y_u;  ///< d(x, y)/du
    float x_v, y_v;  ///< d(x, y)/dv
  };
  [[nodiscard]] const Ray& at(int u, int v) const {
    return rays_[static_cast<std::size_t>(v) * width_ + u];
  }
  /// Pixel of a direction.
  [[nodiscard]] Eigen::Vector2d project(double x, double y) const;

 private:
  void tabulate();
  [[nodiscard]] Eigen::Vector2d undistort(double x, double y) const;

  int width_ = 0, height_ = 0;
  double fx_ = 1, fy_ = 1, cx_ = 0, cy_ = 0;
  std::array<double, 4> distortion_{};
  bool distorted_ = false;
  std::vector<Ray> rays_;
};

/// The cameras of a world.
struct StereoRig {
  CameraModel left, right;
  Rigid3 T_left_right;
};

}  // namespace kys_slam::simulator
