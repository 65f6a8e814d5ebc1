// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <functional>
#include <vector>

#include "simulator/common/lens.h"

namespace kys_slam::simulator {

/// One camera's geometry as viewing rays: for each pixel the direction (x, y, 1) in the camera
/// frame (x right, y down, z forward) and its change per pixel.
class CameraModel {
 public:
  using Mapping = std::function<Eigen::Vector2d(double, double)>;

  CameraModel() = default;
  CameraModel(int width, int height, const Lens& lens);
  /// \param ray  direction (x, y, 1) through a pixel  \param project  its inverse
  CameraModel(int width, int height, Mapping ray, Mapping project);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// Direction through (u, v) px; fractions are measured from the nearest pixel's centre.
  [[nodiscard]] Eigen::Vector2d ray(double u, double v) const { return ray_(u, v); }
  struct Ray {
    float x, y;      ///< direction (x, y, 1)
    float x_u, y_u;  ///< d(x, y)/du
    float x_v, y_v;  ///< d(x, y)/dv
  };
  [[nodiscard]] const Ray& at(int u, int v) const {
    return rays_[static_cast<std::size_t>(v) * width_ + u];
  }
  /// Pixel of a direction.
  [[nodiscard]] Eigen::Vector2d project(double x, double y) const { return project_(x, y); }

 private:
  void tabulate();

  int width_ = 0, height_ = 0;
  Mapping ray_, project_;
  std::vector<Ray> rays_;
};

/// The ideal camera of a rectified pair.
CameraModel pinhole(const StereoCamera& camera);

/// The cameras of a world.
struct StereoRig {
  CameraModel left, right;
  Rigid3 T_left_right;
};

}  // namespace kys_slam::simulator
