// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/lens.h"

namespace kys_slam::simulator {
namespace {

Eigen::Vector2d distort(const std::array<double, 4>& k, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k[0] + r2 * k[1]);
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y};
}

}  // namespace

Eigen::Vector2d Lens::ray(double u, double v) const {
  const Eigen::Vector2d distorted((u - c_x) / f_x, (v - c_y) / f_y);
  if (distortion == std::array<double, 4>{}) return distorted;
  Eigen::Vector2d p = distorted;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector2d error = distorted - distort(distortion, p.x(), p.y());
    p += error;
    if (error.squaredNorm() < 1e-26) break;
  }
  return p;
}

Eigen::Vector2d Lens::project(double x, double y) const {
  const bool straight = distortion == std::array<double, 4>{};
  const Eigen::Vector2d d = straight ? Eigen::Vector2d(x, y) : distort(distortion, x, y);
  return {f_x * d.x() + c_x, f_y * d.y() + c_y};
}

// Beyond a fold the iteration of ray() does not converge: its steps grow.
bool Lens::is_invertible(int width, int height) const {
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel((width - 1.0) * i / kSteps, (height - 1.0) * j / kSteps);
      const Eigen::Vector2d d = ray(pixel.x(), pixel.y());
      if (!((project(d.x(), d.y()) - pixel).norm() < 1e-7)) return false;
    }
  }
  return true;
}

}  // namespace kys_slam::simulator
