// SPDX-License-Identifier: BSD-3-Clause
#include "camera/lens.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <array>

namespace kys_slam {

namespace {

/// A radial-tangential lens at a point of the plane z = 1, at radius r: the factor of the radial
/// part and the shift of the tangential one.
class Distortion {
 public:
  explicit Distortion(const RawCamera& camera) {
    std::copy_n(camera.distortion.begin(), std::min(camera.distortion.size(), k_.size()),
                k_.begin());
  }

  [[nodiscard]] double factor(const Eigen::Vector2d& p) const {
    const double r2 = p.squaredNorm();
    return (1 + ((k_[4] * r2 + k_[1]) * r2 + k_[0]) * r2) /
           (1 + ((k_[7] * r2 + k_[6]) * r2 + k_[5]) * r2);
  }
  [[nodiscard]] Eigen::Vector2d shift(const Eigen::Vector2d& p) const {
    const double r2 = p.squaredNorm(), xy = 2 * p.x() * p.y();
    return {k_[2] * xy + k_[3] * (r2 + 2 * p.x() * p.x()),
            k_[2] * (r2 + 2 * p.y() * p.y()) + k_[3] * xy};
  }

 private:
  std::array<double, 8> k_{};  // k1 k2 p1 p2 k3 k4 k5 k6
};

Eigen::Vector2d pixel(const RawCamera& c, const Eigen::Vector2d& p) {
  return {c.fx * p.x() + c.cx, c.fy * p.y() + c.cy};
}

std::optional<Eigen::Vector2d> project_equidistant(const RawCamera& c, const Eigen::Vector3d& ray) {
  const double r = ray.head<2>().norm();
  const double theta = kys::portable::atan2(r, ray.z());
  double bent = theta, slope = 1, power = 1;
  for (std::size_t i = 0; i < 4; ++i) {
    power *= theta * theta;
    bent += c.distortion[i] * power * theta;
    slope += static_cast<double>(2 * i + 3) * c.distortion[i] * power;
  }
  if (!(slope > 0)) return std::nullopt;  // the image folds back onto itself
  const double k = r > 1e-12 ? bent / r : 1 / ray.z();
  return pixel(c, k * ray.head<2>());
}

}  // namespace

std::optional<Eigen::Vector2d> project(const RawCamera& camera, const Eigen::Vector3d& ray) {
  if (camera.lens == LensModel::kEquidistant) return project_equidistant(camera, ray);
  const Eigen::Vector2d p = ray.head<2>() / ray.z();
  const Distortion lens(camera);
  const Eigen::Vector2d distorted = pixel(camera, lens.factor(p) * p + lens.shift(p));
  return distorted.allFinite() ? std::optional(distorted) : std::nullopt;
}

Eigen::Vector2d undistorted(const RawCamera& camera, double u, double v) {
  const Distortion lens(camera);
  const Eigen::Vector2d distorted((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
  Eigen::Vector2d p = distorted;
  for (int i = 0; i < 5; ++i) {
    const double factor = lens.factor(p);
    if (factor < 0) return distorted;
    p = (distorted - lens.shift(p)) / factor;
  }
  return p;
}

}  // namespace kys_slam
