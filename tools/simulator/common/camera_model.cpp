// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/camera_model.h"

namespace kys_slam::simulator {
namespace {

Eigen::Vector2d distort(const std::array<double, 4>& k, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k[0] + r2 * k[1]);
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y};
}

}  // namespace

CameraModel CameraModel::pinhole(int width, int height, double f_x, double f_y, double c_x,
                                 double c_y) {
  CameraModel m;
  m.width_ = width;
  m.height_ = height;
  m.fx_ = f_x;
  m.fy_ = f_y;
  m.cx_ = c_x;
  m.cy_ = c_y;
  m.tabulate();
  return m;
}

CameraModel CameraModel::radtan(int width, int height, double f_x, double f_y, double c_x,
                                double c_y, const std::array<double, 4>& distortion) {
  CameraModel m = pinhole(width, height, f_x, f_y, c_x, c_y);
  m.distortion_ = distortion;
  m.distorted_ = true;
  m.tabulate();
  return m;
}

Eigen::Vector2d CameraModel::undistort(double x, double y) const {
  if (!distorted_) return {x, y};
  Eigen::Vector2d p(x, y);
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector2d error = Eigen::Vector2d(x, y) - distort(distortion_, p.x(), p.y());
    p += error;
    if (error.squaredNorm() < 1e-26) break;
  }
  return p;
}

Eigen::Vector2d CameraModel::ray(double u, double v) const {
  return undistort((u - cx_) / fx_, (v - cy_) / fy_);
}

Eigen::Vector2d CameraModel::project(double x, double y) const {
  const Eigen::Vector2d d = distorted_ ? distort(distortion_, x, y) : Eigen::Vector2d(x, y);
  return {fx_ * d.x() + cx_, fy_ * d.y() + cy_};
}

void CameraModel::tabulate() {
  rays_.resize(static_cast<std::size_t>(width_) * height_);
  for (int v = 0; v < height_; ++v) {
    for (int u = 0; u < width_; ++u) {
      const Eigen::Vector2d d = ray(u, v);
      const Eigen::Vector2d du = ray(u + 0.5, v) - ray(u - 0.5, v);
      const Eigen::Vector2d dv = ray(u, v + 0.5) - ray(u, v - 0.5);
      rays_[static_cast<std::size_t>(v) * width_ + u] = {
          static_cast<float>(d.x()),  static_cast<float>(d.y()),  static_cast<float>(du.x()),
          static_cast<float>(du.y()), static_cast<float>(dv.x()), static_cast<float>(dv.y())};
    }
  }
}

}  // namespace kys_slam::simulator
