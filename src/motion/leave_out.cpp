// SPDX-License-Identifier: BSD-3-Clause
#include "motion/leave_out.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "geometry/reprojection.h"

namespace kys_slam {

namespace {

// Standard deviations of a pose without observations: it gives no information about any instance.
constexpr double kUnknownRotation = 1;      // rad
constexpr double kUnknownTranslation = 10;  // m

}  // namespace

PoseWithout::PoseWithout(const StereoCamera& camera, const Rigid3& T_c_w,
                         std::span<const PoseTerm> terms) {
  const Eigen::Matrix3d R = T_c_w.R();
  for (const PoseTerm& term : terms) {
    const Eigen::Vector3d p = R * term.p_w + T_c_w.translation;
    if (p.z() < kMinDepth) continue;
    const double weight =
        static_cast<double>(term.weight) * term.pixel.inv_sigma * term.pixel.inv_sigma;
    Eigen::Vector3d e =
        reprojection_error(camera, p, term.pixel.u, term.pixel.v, term.pixel.u_right);
    Eigen::Matrix3d J = reprojection_jacobian(camera, p);
    if (std::isnan(term.pixel.u_right)) {
      e.z() = 0;
      J.row(2).setZero();
    }
    const InformationRatio& ratio = term.pixel.ratio;
    const Eigen::Vector3d weights = weight * Eigen::Vector3d(1, ratio.v, ratio.disparity);
    const Eigen::Matrix3d JW = J.transpose() * weights.asDiagonal();
    const Eigen::Matrix3d M = JW * J;
    const Eigen::Vector3d g = JW * e;
    const Eigen::Matrix3d H = hat(p);
    const Eigen::Matrix3d HM = H * M;
    const auto add = [&](Sums& sums) {
      sums.A.topLeftCorner<3, 3>() -= HM * H;
      sums.A.topRightCorner<3, 3>() += HM;
      sums.A.bottomLeftCorner<3, 3>() += HM.transpose();
      sums.A.bottomRightCorner<3, 3>() += M;
      sums.b.head<3>() += p.cross(g);
      sums.b.tail<3>() += g;
    };
    add(all_);
    if (term.instance >= 0) add(of_instance_[term.instance]);
  }
}

PoseIncrement PoseWithout::without(std::int32_t instance) const {
  Matrix6d A = all_.A;
  Vector6d b = Vector6d::Zero();  // all terms together are at their minimum
  if (const auto own = of_instance_.find(instance); own != of_instance_.end()) {
    A -= own->second.A;
    b = all_.b - own->second.b;
  }
  A.diagonal().head<3>().array() += 1 / (kUnknownRotation * kUnknownRotation);
  A.diagonal().tail<3>().array() += 1 / (kUnknownTranslation * kUnknownTranslation);
  const Eigen::LDLT<Matrix6d> factor(A);
  PoseIncrement result;
  result.covariance = factor.solve(Matrix6d::Identity());
  result.delta = factor.solve(-b);
  return result;
}

CameraMotion camera_motion(const Rigid3& T_before_w, const PoseIncrement& before,
                           const Rigid3& T_now_w, const PoseIncrement& now) {
  CameraMotion motion;
  motion.T_now_before = now.applied_to(T_now_w) * before.applied_to(T_before_w).inverse();
  // An increment of the earlier frame, expressed in the present one.
  const Matrix6d change = adjoint(motion.T_now_before);
  motion.covariance = now.covariance + change * before.covariance * change.transpose();
  return motion;
}

}  // namespace kys_slam
