#include "geometry/pose_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <vector>

#include "geometry/reprojection.h"
#include "geometry/so3.h"

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

/// J^T W J and J^T W r for the increment of plus_left(). Returns the cost.
double normal_equations(const StereoCamera& camera, const Rigid3& T_a_b,
                        std::span<const ReprojectionTerm> terms,
                        std::span<const Eigen::Matrix3d> information, Matrix6d& H, Vector6d& g) {
  H.setZero();
  g.setZero();
  double cost = 0;
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
    H.noalias() += JtW * J;
    g.noalias() += JtW * e;
    cost += e.dot(information[i] * e);
  }
  return cost;
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
  Rigid3 best = T_a_b;
  std::vector<Eigen::Matrix3d> information;
  information.reserve(terms.size());
  for (const ReprojectionTerm& term : terms) {
    information.push_back(information_of(camera, best, point_in_camera(best, term), term));
  }
  Matrix6d H;
  Vector6d g;
  double cost = normal_equations(camera, best, terms, information, H, g);
  for (int i = 0; i < iterations; ++i) {
    H.diagonal() += 1e-9 * H.diagonal() + Vector6d::Constant(1e-12);
    const Vector6d step = H.ldlt().solve(-g);
    if (!step.allFinite()) break;
    const Rigid3 candidate = plus_left(best, step);
    const double candidate_cost = normal_equations(camera, candidate, terms, information, H, g);
    if (!(candidate_cost < cost)) break;
    const bool converged = cost - candidate_cost <= 1e-9 * cost;
    best = candidate;
    cost = candidate_cost;
    if (converged) break;
  }
  return best;
}

}  // namespace kys_slam
