#pragma once

#include <ceres/sized_cost_function.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

namespace kys_slam {

// Ceres residuals with analytic Jacobians. A pose is a block of six: the increment [rotation (rad);
// translation (m)] of plus() from a pose the residual keeps a pointer to, so that no manifold is
// needed and no gimbal is near.

/// (u_left, v, u_right) of a landmark, predicted minus observed, times the inverse deviation.
/// Blocks: increment of T_c_w (6), point p_w (3).
class StereoReprojectionCost final : public ceres::SizedCostFunction<3, 6, 3> {
 public:
  StereoReprojectionCost(const StereoCamera* camera, const Rigid3* T_c_w,
                         const Eigen::Vector3d& observed, double inv_sigma)
      : camera_(camera), T_c_w_(T_c_w), observed_(observed), inv_sigma_(inv_sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const StereoCamera* camera_;
  const Rigid3* T_c_w_;
  Eigen::Vector3d observed_;
  double inv_sigma_;
};

/// (u, v) of a landmark in the left image. Blocks as for StereoReprojectionCost.
class MonoReprojectionCost final : public ceres::SizedCostFunction<2, 6, 3> {
 public:
  MonoReprojectionCost(const StereoCamera* camera, const Rigid3* T_c_w,
                       const Eigen::Vector2d& observed, double inv_sigma)
      : camera_(camera), T_c_w_(T_c_w), observed_(observed), inv_sigma_(inv_sigma) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const StereoCamera* camera_;
  const Rigid3* T_c_w_;
  Eigen::Vector2d observed_;
  double inv_sigma_;
};

/// Weighted [log of the rotation (rad); translation (m)] of T_a_b^-1 * T_w_a^-1 * T_w_b.
/// Blocks: increment of T_w_a (6), increment of T_w_b (6).
class RelativePoseCost final : public ceres::SizedCostFunction<6, 6, 6> {
 public:
  RelativePoseCost(const Rigid3* T_w_a, const Rigid3* T_w_b, const Rigid3& T_a_b, double weight)
      : T_w_a_(T_w_a), T_w_b_(T_w_b), T_a_b_(T_a_b), weight_(weight) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const Rigid3* T_w_a_;
  const Rigid3* T_w_b_;
  Rigid3 T_a_b_;
  double weight_;
};

}  // namespace kys_slam
