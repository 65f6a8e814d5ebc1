// SPDX-License-Identifier: BSD-3-Clause
#include "prediction.h"

#include <Eigen/LU>
#include <algorithm>

namespace kys_slam {

namespace {

using RigJacobian = Eigen::Matrix<double, 2, RigCorrection::kSize>;

constexpr int at(RigParameter p) {
  return static_cast<int>(p);
}

/// Derivative of a map of pixels. The maps are polynomials of low order: the differences are exact
/// to many digits.
template <typename Map>
Eigen::Matrix2d slope(const Eigen::Vector2d& p, const Map& map) {
  constexpr double kStep = 0.5;  // px
  Eigen::Matrix2d J;
  J.col(0) = (map(p.x() + kStep, p.y()) - map(p.x() - kStep, p.y())) / (2 * kStep);
  J.col(1) = (map(p.x(), p.y() + kStep) - map(p.x(), p.y() - kStep)) / (2 * kStep);
  return J;
}

/// The ray of a point in the right camera, before its lens and pose, by x, y (of the left ray) and
/// q = baseline / depth.
struct RightRay {
  Eigen::Matrix<double, 2, 3> by_ray;
  Eigen::Vector2d by_baseline_y;
  Eigen::Vector2d by_baseline_z;

  RightRay(const RigCorrection& rig, double x, double y, double q) {
    const double by = rig[RigParameter::kBaselineY], bz = rig[RigParameter::kBaselineZ];
    const double n = 1 - bz * q;
    const Eigen::Vector2d ray((x - q) / n, (y - by * q) / n);
    by_ray << 1, 0, -1 + bz * ray.x(),  //
        0, 1, -by + bz * ray.y();
    by_ray /= n;
    by_baseline_y << 0, -q / n;
    by_baseline_z = ray * q / n;
  }
};

}  // namespace

Prediction predict(const StereoCamera& given, const RigCorrection& rig, const Eigen::Vector3d& p_c,
                   bool derivatives) {
  const double z = std::max(p_c.z(), kNearest);
  const double x = p_c.x() / z, y = p_c.y() / z;
  const Eigen::Vector2d f(given.fx, given.fy), c(given.cx, given.cy);
  const Eigen::Vector2d ideal = f.cwiseProduct(Eigen::Vector2d(x, y)) + c;
  const Eigen::Vector2d left = rig.measured_left(ideal.x(), ideal.y());
  const Eigen::Vector2d right =
      rig.measured_right(ideal.x(), ideal.y(), ideal.x() - given.bf() / z);
  Prediction p;
  p.value << left, left.x() - right.x(), right.y() - left.y();
  if (!derivatives) return p;

  const double scale = rig.focal_scale();
  const double q = given.baseline / (z * scale);
  const RigCorrection::Jacobian J =
      rig.jacobian({static_cast<float>(left.x()), static_cast<float>(left.y()),
                    static_cast<float>(right.x()), static_cast<float>(right.y())});
  const Eigen::Matrix2d left_inverse =
      slope(left, [&](double u, double v) { return rig.left(u, v); }).inverse();
  const Eigen::Matrix2d right_inverse =
      slope(right, [&](double u, double v) { return rig.right(u, v); }).inverse();
  const RightRay ray(rig, x, y, q);
  const Eigen::Matrix2d right_by_ray = right_inverse * f.asDiagonal();

  // Where corrected positions stay, measured ones move against the correction.
  constexpr int kLensTerms = at(RigParameter::kRightK1) - at(RigParameter::kLeftK1);
  constexpr int kOfRight = at(RigParameter::kBaselineY) - at(RigParameter::kRightK1);
  RigJacobian left_by_rig = RigJacobian::Zero(), right_by_rig = RigJacobian::Zero();
  left_by_rig.leftCols<kLensTerms>() = -left_inverse * J.topLeftCorner<2, kLensTerms>();
  left_by_rig.col(at(RigParameter::kFocal)) = (left - c) / scale;
  RigJacobian corrected = RigJacobian::Zero();  // the right position; J is of left less right
  corrected.row(0).segment<kOfRight>(kLensTerms) = -J.row(2).segment<kOfRight>(kLensTerms);
  corrected.row(1).segment<kOfRight>(kLensTerms) = J.row(3).segment<kOfRight>(kLensTerms);
  right_by_rig = -right_inverse * corrected;
  right_by_rig.col(at(RigParameter::kBaselineY)) = right_by_ray * ray.by_baseline_y;
  right_by_rig.col(at(RigParameter::kBaselineZ)) = right_by_ray * ray.by_baseline_z;
  right_by_rig.col(at(RigParameter::kFocal)) =
      (right - c) / scale - right_by_ray * ray.by_ray.col(2) * (q / scale);
  p.by_rig << left_by_rig, left_by_rig.row(0) - right_by_rig.row(0),
      right_by_rig.row(1) - left_by_rig.row(1);

  Eigen::Matrix3d by_p_c;  // of x, y, q
  by_p_c << 1, 0, -x, 0, 1, -y, 0, 0, -q;
  by_p_c /= z;
  if (p_c.z() < kNearest) by_p_c.col(2).setZero();
  const Eigen::Matrix<double, 2, 3> left_by_point =
      left_inverse * f.asDiagonal() * by_p_c.topRows<2>();
  const Eigen::Matrix<double, 2, 3> right_by_point = right_by_ray * ray.by_ray * by_p_c;
  p.by_point << left_by_point, left_by_point.row(0) - right_by_point.row(0),
      right_by_point.row(1) - left_by_point.row(1);
  return p;
}

}  // namespace kys_slam
