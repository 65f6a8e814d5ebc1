// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/camera_model.h"

#include <utility>

namespace kys_slam::simulator {

CameraModel::CameraModel(int width, int height, const Lens& lens)
    : CameraModel(
          width, height, [lens](double u, double v) { return lens.ray(u, v); },
          [lens](double x, double y) { return lens.project(x, y); }) {}

CameraModel::CameraModel(int width, int height, Mapping ray, Mapping project)
    : width_(width), height_(height), ray_(std::move(ray)), project_(std::move(project)) {
  tabulate();
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

CameraModel pinhole(const StereoCamera& k) {
  return {k.width, k.height, Lens{k.fx, k.fy, k.cx, k.cy, {}}};
}

}  // namespace kys_slam::simulator
