#include <Eigen/Eigenvalues>
#include <cmath>

#include "geometry/absolute_orientation.h"
#include "geometry/pnp.h"

namespace kys_slam {
namespace {

/// Sides opposite to the points and cosines of the angles between the rays, named as by Haralick:
/// a = |p2-p3|, b = |p1-p3|, c = |p1-p2|; alpha between rays 2 and 3, beta 1 and 3, gamma 1 and 2.
struct Tetrahedron {
  double a2, b2, c2;
  double alpha, beta, gamma;
};

/// Coefficients of the quartic in v = s3/s1, lowest power first.
std::array<double, 5> grunert_quartic(const Tetrahedron& t) {
  const double p = (t.a2 - t.c2) / t.b2;
  const double q = (t.a2 + t.c2) / t.b2;
  const double c_b = t.c2 / t.b2;
  const double a_b = t.a2 / t.b2;
  const double alpha2 = t.alpha * t.alpha;
  const double gamma2 = t.gamma * t.gamma;
  return {(1 + p) * (1 + p) - 4 * a_b * gamma2,
          4 * (-p * (1 + p) * t.beta + 2 * a_b * gamma2 * t.beta - (1 - q) * t.alpha * t.gamma),
          2 * (p * p - 1 + 2 * p * p * t.beta * t.beta + 2 * (1 - c_b) * alpha2 -
               4 * q * t.alpha * t.beta * t.gamma + 2 * (1 - a_b) * gamma2),
          4 * (p * (1 - p) * t.beta - (1 - q) * t.alpha * t.gamma + 2 * c_b * alpha2 * t.beta),
          (p - 1) * (p - 1) - 4 * c_b * alpha2};
}

/// Real roots of a quartic whose leading coefficient is not negligible.
std::vector<double> real_roots(const std::array<double, 5>& k) {
  double largest = 0;
  for (const double x : k) largest = std::max(largest, std::abs(x));
  if (!(std::abs(k[4]) > 1e-12 * largest)) return {};
  Eigen::Matrix4d companion = Eigen::Matrix4d::Zero();
  companion.bottomLeftCorner<3, 3>().setIdentity();
  for (int i = 0; i < 4; ++i) companion(i, 3) = -k[static_cast<std::size_t>(i)] / k[4];
  if (!companion.allFinite()) return {};
  const Eigen::EigenSolver<Eigen::Matrix4d> solver(companion, false);
  if (solver.info() != Eigen::Success) return {};
  std::vector<double> roots;
  for (int i = 0; i < 4; ++i) {
    const std::complex<double> root = solver.eigenvalues()[i];
    // Double roots come out as a pair a little off the real line.
    if (std::abs(root.imag()) < 1e-4 * (1 + std::abs(root.real()))) roots.push_back(root.real());
  }
  return roots;
}

/// Newton's method on the three cosine laws: takes out what the quartic lost to rounding.
void polish(const Tetrahedron& t, Eigen::Vector3d& s) {
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d f(s[1] * s[1] + s[2] * s[2] - 2 * s[1] * s[2] * t.alpha - t.a2,
                            s[0] * s[0] + s[2] * s[2] - 2 * s[0] * s[2] * t.beta - t.b2,
                            s[0] * s[0] + s[1] * s[1] - 2 * s[0] * s[1] * t.gamma - t.c2);
    Eigen::Matrix3d J;
    J << 0, s[1] - s[2] * t.alpha, s[2] - s[1] * t.alpha,  //
        s[0] - s[2] * t.beta, 0, s[2] - s[0] * t.beta,     //
        s[0] - s[1] * t.gamma, s[1] - s[0] * t.gamma, 0;
    const Eigen::Vector3d step = 0.5 * (J.inverse() * f);
    if (!step.allFinite() || step.norm() > 0.1 * s.norm()) return;
    s -= step;
  }
}

}  // namespace

std::vector<Rigid3> solve_p3p(const std::array<Eigen::Vector3d, 3>& rays,
                              const std::array<Eigen::Vector3d, 3>& points) {
  const Tetrahedron t{(points[1] - points[2]).squaredNorm(),
                      (points[0] - points[2]).squaredNorm(),
                      (points[0] - points[1]).squaredNorm(),
                      rays[1].dot(rays[2]),
                      rays[0].dot(rays[2]),
                      rays[0].dot(rays[1])};
  std::vector<Rigid3> solutions;
  if (!(t.a2 > 0) || !(t.b2 > 0) || !(t.c2 > 0)) return solutions;
  const double p = (t.a2 - t.c2) / t.b2;
  for (const double v : real_roots(grunert_quartic(t))) {
    const double divisor = 2 * (t.gamma - v * t.alpha);
    const double u = ((p - 1) * v * v - 2 * p * t.beta * v + 1 + p) / divisor;
    const double s1_squared = t.b2 / (1 + v * v - 2 * v * t.beta);
    if (!(v > 0) || !(u > 0) || !(s1_squared > 0) || !std::isfinite(u)) continue;
    Eigen::Vector3d s = std::sqrt(s1_squared) * Eigen::Vector3d(1, u, v);
    polish(t, s);
    const std::array<Eigen::Vector3d, 3> p_c{s[0] * rays[0], s[1] * rays[1], s[2] * rays[2]};
    if (const auto T_c_w = absolute_orientation(p_c, points)) solutions.push_back(*T_c_w);
  }
  return solutions;
}

}  // namespace kys_slam
