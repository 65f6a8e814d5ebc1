// SPDX-License-Identifier: BSD-3-Clause
#include "camera/bouguet.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "camera/lens.h"

namespace kys_slam {

namespace {

/// The rectangle inside the rectified border of the raw image, which is sampled.
struct Inside {
  double left = -std::numeric_limits<double>::max();
  double top = left;
  double right = -left;
  double bottom = -left;
};

/// One camera with focal length `f` after rectification. OpenCV's stereoRectify() rounds positions
/// to float on the way, which moves its intrinsics by some 1e-5 px; these are continuous.
struct Turned {
  const RawCamera& camera;
  const Eigen::Matrix3d& R;
  double f;

  /// Where a point of the plane z = 1 comes to lie, relative to the principal point, px.
  [[nodiscard]] Eigen::Vector2d rectified(const Eigen::Vector2d& p) const {
    const Eigen::Vector3d ray = R * Eigen::Vector3d(p.x(), p.y(), 1);
    return f * Eigen::Vector2d(ray.x() / ray.z(), ray.y() / ray.z());
  }

  /// Mean of the corners.
  [[nodiscard]] Eigen::Vector2d middle() const {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (const double v : {0.0, camera.height - 1.0}) {
      for (const double u : {0.0, camera.width - 1.0}) {
        sum += rectified(undistorted(camera, u, v));
      }
    }
    return sum / 4;
  }

  [[nodiscard]] Inside inside() const {
    constexpr int kSteps = 8;
    const double width = camera.width, height = camera.height;
    const auto at = [&](double u, double v) { return rectified(undistorted(camera, u, v)); };
    Inside in;
    for (int i = 0; i <= kSteps; ++i) {
      const double u = i * width / kSteps, v = i * height / kSteps;
      in.left = std::max(in.left, at(0, v).x());
      in.right = std::min(in.right, at(width, v).x());
      in.top = std::max(in.top, at(u, 0).y());
      in.bottom = std::min(in.bottom, at(u, height).y());
    }
    return in;
  }
};

}  // namespace

std::optional<RectifyingRotations> rectifying_rotations(const Rigid3& T_r_l) {
  const Eigen::Matrix3d half = so3_exp(-0.5 * so3_log(T_r_l.rotation)).toRotationMatrix();
  const Eigen::Vector3d t = half * T_r_l.t();
  if (!(std::abs(t.x()) > std::abs(t.y()))) return std::nullopt;
  const Eigen::Vector3d axis = t.cross(Eigen::Vector3d(t.x() > 0 ? 1 : -1, 0, 0));
  const double sine = axis.norm();
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  if (sine > 0) {
    const double angle = kys::portable::atan2(sine, std::abs(t.x()));
    turn = so3_exp(angle / sine * axis).toRotationMatrix();
  }
  RectifyingRotations result;
  result.R_rectified_raw = {turn * half.transpose(), turn * half};
  result.shift = result.R_rectified_raw[1] * T_r_l.t();
  return result;
}

RectifiedIntrinsics fitting_intrinsics(const RawCamera& left, const RawCamera& right,
                                       const RectifyingRotations& rotations) {
  const double f = (left.fy + right.fy) / 2;
  const std::array<Turned, 2> turned{Turned{left, rotations.R_rectified_raw[0], f},
                                     Turned{right, rotations.R_rectified_raw[1], f}};
  const Eigen::Vector2d centre((left.width - 1) / 2.0, (left.height - 1) / 2.0);
  const Eigen::Vector2d c = ((centre - turned[0].middle()) + (centre - turned[1].middle())) * 0.5;
  // The scale at which each side of the image meets that of the rectangle.
  double scale = 0;
  for (const Turned& camera : turned) {
    const Inside in = camera.inside();
    scale = std::max({scale, -c.x() / in.left, -c.y() / in.top, (left.width - c.x()) / in.right,
                      (left.height - c.y()) / in.bottom});
  }
  return {f * scale, c.x(), c.y()};
}

}  // namespace kys_slam
