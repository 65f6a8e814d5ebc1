#include "geometry/triangulation.h"

#include <Eigen/LU>
#include <cmath>

#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

using Matrix23 = Eigen::Matrix<double, 2, 3>;

/// Errors of the point in both left images, px.
struct TwoErrors {
  Eigen::Vector2d a;
  Eigen::Vector2d b;
  Eigen::Vector3d p_b;
};

TwoErrors errors_of(const StereoCamera& camera, const Rigid3& T_b_a, const Eigen::Vector3d& p_a,
                    const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b) {
  const Eigen::Vector3d p_b = T_b_a * p_a;
  return {reprojection_error(camera, p_a, x_a.x(), x_a.y(), 0).head<2>(),
          reprojection_error(camera, p_b, x_b.x(), x_b.y(), 0).head<2>(), p_b};
}

/// Gauss-Newton on the squared errors over their variances, as long as they fall.
void refine(const StereoCamera& camera, const Rigid3& T_b_a, const Eigen::Vector2d& x_a,
            const Eigen::Vector2d& x_b, double weight_a, double weight_b, Eigen::Vector3d& p_a) {
  const Eigen::Matrix3d R_b_a = T_b_a.R();
  TwoErrors e = errors_of(camera, T_b_a, p_a, x_a, x_b);
  double cost = weight_a * e.a.squaredNorm() + weight_b * e.b.squaredNorm();
  for (int i = 0; i < 3; ++i) {
    const Matrix23 J_a = reprojection_jacobian(camera, p_a).topRows<2>();
    const Matrix23 J_b = reprojection_jacobian(camera, e.p_b).topRows<2>() * R_b_a;
    const Eigen::Matrix3d H = weight_a * J_a.transpose() * J_a + weight_b * J_b.transpose() * J_b;
    const Eigen::Vector3d g = weight_a * J_a.transpose() * e.a + weight_b * J_b.transpose() * e.b;
    const Eigen::Vector3d candidate = p_a - H.inverse() * g;
    if (!candidate.allFinite()) return;
    const TwoErrors next = errors_of(camera, T_b_a, candidate, x_a, x_b);
    const double next_cost = weight_a * next.a.squaredNorm() + weight_b * next.b.squaredNorm();
    if (!(next_cost < cost)) return;
    const bool converged = cost - next_cost < 1e-6 * cost;
    p_a = candidate;
    cost = next_cost;
    e = next;
    if (converged) return;
  }
}

}  // namespace

double ray_parallax_cosine(const StereoCamera& camera, const Rigid3& T_a_b,
                           const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b) {
  const Eigen::Vector3d f_a = camera.back_project(x_a.x(), x_a.y(), 1.0);
  const Eigen::Vector3d f_b = T_a_b.rotation * camera.back_project(x_b.x(), x_b.y(), 1.0);
  return f_a.dot(f_b) / std::sqrt(f_a.squaredNorm() * f_b.squaredNorm());
}

TwoViewPoint triangulate(const StereoCamera& camera, const Rigid3& T_a_b,
                         const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b, double sigma_a,
                         double sigma_b) {
  TwoViewPoint result;
  result.p_a.setZero();
  const Eigen::Vector3d f_a = camera.back_project(x_a.x(), x_a.y(), 1.0).normalized();
  const Eigen::Vector3d f_b =
      (T_a_b.rotation * camera.back_project(x_b.x(), x_b.y(), 1.0)).normalized();
  const double c = f_a.dot(f_b);
  if (!std::isfinite(c) || !T_a_b.is_finite()) return result;
  result.cos_parallax = c;

  // Nearest points of the rays s*f_a and t + r*f_b.
  const double sin_squared = f_a.cross(f_b).squaredNorm();
  if (sin_squared < 1e-14) return result;
  const Eigen::Vector3d& t = T_a_b.translation;
  const double along_a = f_a.dot(t);
  const double along_b = f_b.dot(t);
  const double s = (along_a - c * along_b) / sin_squared;
  const double r = (c * along_a - along_b) / sin_squared;
  Eigen::Vector3d p_a = 0.5 * (s * f_a + t + r * f_b);
  const Rigid3 T_b_a = T_a_b.inverse();
  if (p_a.z() < kMinDepth || (T_b_a * p_a).z() < kMinDepth) return result;

  refine(camera, T_b_a, x_a, x_b, 1.0 / (sigma_a * sigma_a), 1.0 / (sigma_b * sigma_b), p_a);
  const TwoErrors e = errors_of(camera, T_b_a, p_a, x_a, x_b);
  result.p_a = p_a;
  result.error_a = e.a.norm();
  result.error_b = e.b.norm();
  result.valid = p_a.allFinite() && p_a.z() >= kMinDepth && e.p_b.z() >= kMinDepth;
  return result;
}

}  // namespace kys_slam
