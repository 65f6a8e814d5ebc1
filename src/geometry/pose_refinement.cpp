#include "geometry/pose_refinement.h"

#include <Eigen/Cholesky>
#include <limits>

#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

Eigen::Vector3d point_in_camera(const Rigid3& T_a_b, const ReprojectionTerm& term) {
  return term.inverse ? T_a_b.inverse() * term.point : T_a_b * term.point;
}

/// Error of a term over its deviation; the third row is zero for a monocular one.
Eigen::Vector3d whitened_error(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                               const StereoPixel& pixel) {
  Eigen::Vector3d e = reprojection_error(camera, p_c, pixel.u, pixel.v, pixel.u_right);
  if (std::isnan(pixel.u_right)) e.z() = 0;
  return pixel.inv_sigma * e;
}

/// J^T J and J^T r for the increment p_a -> exp(w) p_a + v. Returns the cost.
double normal_equations(const StereoCamera& camera, const Rigid3& T_a_b,
                        std::span<const ReprojectionTerm> terms, Matrix6d& H, Vector6d& g) {
  H.setZero();
  g.setZero();
  double cost = 0;
  const Eigen::Matrix3d R_b_a = T_a_b.R().transpose();
  for (const ReprojectionTerm& term : terms) {
    const Eigen::Vector3d p_c = point_in_camera(T_a_b, term);
    const Eigen::Vector3d e = whitened_error(camera, p_c, term.pixel);
    Eigen::Matrix3d J_point = term.pixel.inv_sigma * reprojection_jacobian(camera, p_c);
    if (std::isnan(term.pixel.u_right)) J_point.row(2).setZero();
    Eigen::Matrix<double, 3, 6> J;
    if (term.inverse) {
      // T_b_a exp(-d) p_a = T_b_a (p_a - w x p_a - v)
      const Eigen::Matrix3d J_b = J_point * R_b_a;
      J << J_b * hat(term.point), -J_b;
    } else {
      J << -J_point * hat(p_c), J_point;
    }
    H.noalias() += J.transpose() * J;
    g.noalias() += J.transpose() * e;
    cost += e.squaredNorm();
  }
  return cost;
}

}  // namespace

double reprojection_chi2(const StereoCamera& camera, const Rigid3& T_a_b,
                         const ReprojectionTerm& term) {
  const Eigen::Vector3d p_c = point_in_camera(T_a_b, term);
  if (!(p_c.z() >= kMinDepth)) return std::numeric_limits<double>::infinity();
  return whitened_error(camera, p_c, term.pixel).squaredNorm();
}

Rigid3 refine_pose(const StereoCamera& camera, const Rigid3& T_a_b,
                   std::span<const ReprojectionTerm> terms, int iterations) {
  Rigid3 best = T_a_b;
  Matrix6d H;
  Vector6d g;
  double cost = normal_equations(camera, best, terms, H, g);
  for (int i = 0; i < iterations; ++i) {
    H.diagonal() += 1e-9 * H.diagonal() + Vector6d::Constant(1e-12);
    const Vector6d step = H.ldlt().solve(-g);
    if (!step.allFinite()) break;
    const Eigen::Quaterniond turn = so3_exp(step.head<3>());
    const Rigid3 candidate(turn * best.rotation, turn * best.translation + step.tail<3>());
    const double candidate_cost = normal_equations(camera, candidate, terms, H, g);
    if (!(candidate_cost < cost)) break;
    const bool converged = cost - candidate_cost <= 1e-9 * cost;
    best = candidate;
    cost = candidate_cost;
    if (converged) break;
  }
  return best;
}

}  // namespace kys_slam
