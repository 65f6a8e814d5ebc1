// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/pose_refinement.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <vector>

#include "geometry/minimise_pose.h"
#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

Eigen::Vector3d point_in_camera(const Rigid3& T_a_b, const ReprojectionTerm& term) {
  return term.inverse ? T_a_b.inverse() * term.point : T_a_b * term.point;
}

/// Error in px; the third row is zero for a monocular pixel.
Eigen::Vector3d error_of(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                         const StereoPixel& pixel) {
  Eigen::Vector3d e = reprojection_error(camera, p_c, pixel.u, pixel.v, pixel.u_right);
  if (std::isnan(pixel.u_right)) e.z() = 0;
  return e;
}

/// Inverse covariance of the error (1/px^2): that of the pixel and that of the point, projected.
Eigen::Matrix3d information_of(const StereoCamera& camera, const Rigid3& T_a_b,
                               const Eigen::Vector3d& p_c, const ReprojectionTerm& term) {
  const double variance = 1.0 / (static_cast<double>(term.pixel.inv_sigma) * term.pixel.inv_sigma);
  Eigen::Matrix3d R = T_a_b.R();
  if (term.inverse) R.transposeInPlace();
  const Eigen::Matrix3d J = reprojection_jacobian(camera, p_c) * R;
  Eigen::Matrix3d S = J * term.covariance * J.transpose();
  S.diagonal().array() += variance;
  if (!std::isnan(term.pixel.u_right)) return S.inverse();
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  information.topLeftCorner<2, 2>() = S.topLeftCorner<2, 2>().inverse();
  return information;
}

PoseNormalEquations normal_equations(const StereoCamera& camera, const Rigid3& T_a_b,
                                     std::span<const ReprojectionTerm> terms,
                                     std::span<const Eigen::Matrix3d> information) {
  PoseNormalEquations sums{Matrix6d::Zero(), Vector6d::Zero()};
  const Eigen::Matrix3d R_b_a = T_a_b.R().transpose();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const ReprojectionTerm& term = terms[i];
    const Eigen::Vector3d p_c = point_in_camera(T_a_b, term);
    const Eigen::Vector3d e = error_of(camera, p_c, term.pixel);
    const Eigen::Matrix3d J_point = reprojection_jacobian(camera, p_c);
    Eigen::Matrix<double, 3, 6> J;
    if (term.inverse) {
      // T_b_a exp(-d) p_a = T_b_a (p_a - w x p_a - v)
      const Eigen::Matrix3d J_b = J_point * R_b_a;
      J << J_b * hat(term.point), -J_b;
    } else {
      J << -J_point * hat(p_c), J_point;
    }
    const Eigen::Matrix<double, 6, 3> JtW = J.transpose() * information[i];
    sums.hessian.noalias() += JtW * J;
    sums.gradient.noalias() += JtW * e;
    sums.cost += e.dot(information[i] * e);
  }
  return sums;
}

}  // namespace

Eigen::Matrix3d stereo_covariance(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                                  const StereoPixel& pixel) {
  if (std::isnan(pixel.u_right) || !(p_c.z() >= kMinDepth)) return Eigen::Matrix3d::Zero();
  const Eigen::Matrix3d J_inverse = reprojection_jacobian(camera, p_c).inverse();
  const double variance = 1.0 / (static_cast<double>(pixel.inv_sigma) * pixel.inv_sigma);
  return variance * J_inverse * J_inverse.transpose();
}

double reprojection_chi2(const StereoCamera& camera, const Rigid3& T_a_b,
                         const ReprojectionTerm& term) {
  const Eigen::Vector3d p_c = point_in_camera(T_a_b, term);
  if (!(p_c.z() >= kMinDepth)) return std::numeric_limits<double>::infinity();
  const Eigen::Vector3d e = error_of(camera, p_c, term.pixel);
  return e.dot(information_of(camera, T_a_b, p_c, term) * e);
}

Rigid3 refine_pose(const StereoCamera& camera, const Rigid3& T_a_b,
                   std::span<const ReprojectionTerm> terms, int iterations) {
  std::vector<Eigen::Matrix3d> information;
  information.reserve(terms.size());
  for (const ReprojectionTerm& term : terms) {
    information.push_back(information_of(camera, T_a_b, point_in_camera(T_a_b, term), term));
  }
  const PoseMinimisation options{
      .iterations = iterations, .damping = 1e-9, .cost_tolerance = 1e-9, .step_tolerance = 0};
  return minimise_pose(T_a_b, options, [&](const Rigid3& T) {
    return normal_equations(camera, T, terms, information);
  });
}

}  // namespace kys_slam
