// SPDX-License-Identifier: BSD-3-Clause
#include "ceres_reference/cost_functions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "geometry/reprojection.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Compares the analytic derivatives with central differences, of poses by their increments. Not
/// Ceres' own GradientChecker: it hands out Eigen matrices allocated inside the Ceres library,
/// which must not be freed by code compiled with other alignment (sanitizers, -march=native).
void expect_right_gradient(const ceres::CostFunction& cost, const Rigid3& first,
                           const std::vector<double>& second) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const PoseManifold manifold;
  const PoseBlock pose = to_block(first);
  const std::vector<double> x[] = {{pose.begin(), pose.end()}, second};
  const int rows = cost.num_residuals();
  std::vector<RowMajor> J;
  for (const auto& block : x) J.emplace_back(rows, static_cast<Eigen::Index>(block.size()));
  const double* blocks[] = {x[0].data(), x[1].data()};
  double* jacobians[] = {J[0].data(), J[1].data()};
  Eigen::VectorXd residual(rows);
  ASSERT_TRUE(cost.Evaluate(blocks, residual.data(), jacobians));
  const auto at = [&](std::size_t block, int k, double step) {
    std::vector<double> moved = x[block];
    if (moved.size() == kPoseSize) {
      const Vector6d increment = step * Vector6d::Unit(k);
      manifold.Plus(x[block].data(), increment.data(), moved.data());
    } else {
      moved[static_cast<std::size_t>(k)] += step;
    }
    const double* there[] = {block == 0 ? moved.data() : blocks[0],
                             block == 1 ? moved.data() : blocks[1]};
    Eigen::VectorXd result(rows);
    cost.Evaluate(there, result.data(), nullptr);
    return result;
  };
  for (std::size_t block = 0; block < 2; ++block) {
    for (int k = 0; k < std::min<int>(6, static_cast<int>(x[block].size())); ++k) {
      constexpr double kStep = 1e-6;
      const Eigen::VectorXd numeric = (at(block, k, kStep) - at(block, k, -kStep)) / (2 * kStep);
      EXPECT_LT((J[block].col(k) - numeric).norm(), 1e-6 * (1 + J[block].norm()))
          << "block " << block << ", parameter " << k;
    }
  }
}

std::vector<double> as_block(const Rigid3& T) {
  const PoseBlock block = to_block(T);
  return {block.begin(), block.end()};
}

class ReprojectionGradient : public ::testing::TestWithParam<int> {};

TEST_P(ReprojectionGradient, MatchesNumericDifferences) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  const StereoCamera camera = kitti_camera();
  const Rigid3 T_c_w = plus(Rigid3(), random.increment(1.0, 5.0));
  for (int point = 0; point < 3; ++point) {
    const Eigen::Vector3d p_c(random.uniform(-5, 5), random.uniform(-2, 2), random.uniform(3, 40));
    const Eigen::Vector3d p_w = T_c_w.inverse() * p_c;
    const std::vector<double> block(p_w.begin(), p_w.end());
    const Eigen::Vector3d observed = camera.project_stereo(p_c) + random.vector(3);
    expect_right_gradient(StereoReprojectionCost(&camera, observed, 0.7), T_c_w, block);
    expect_right_gradient(MonoReprojectionCost(&camera, observed.head<2>(), 0.7), T_c_w, block);
  }
}

TEST(ReprojectionError, WhereTheLeftKeypointLiesDoesNotTouchTheDisparity) {
  const StereoCamera camera = kitti_camera();
  const Eigen::Vector3d p_c(1, -0.5, 12);
  const Eigen::Vector3d pixel = camera.project_stereo(p_c);
  const Eigen::Vector3d moved =
      reprojection_error(camera, p_c, pixel.x() + 0.3, pixel.y(), pixel.z() + 0.3);
  EXPECT_NEAR(moved.x(), -0.3, 1e-9);
  EXPECT_NEAR(moved.z(), 0, 1e-9);
  const Eigen::Vector3d nearer =
      reprojection_error(camera, p_c, pixel.x(), pixel.y(), pixel.z() - 0.2);
  EXPECT_NEAR(nearer.x(), 0, 1e-9);
  EXPECT_NEAR(nearer.z(), -0.2, 1e-9) << "observed disparity 0.2 px too large";
}

TEST_P(ReprojectionGradient, GoesOnBehindTheCamera) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  const StereoCamera camera = kitti_camera();
  const Eigen::Vector3d p_c(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-5, 0.04));
  const Eigen::Matrix3d J = reprojection_jacobian(camera, p_c);
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d d = 1e-6 * Eigen::Vector3d::Unit(k);
    const Eigen::Vector3d numeric = (reprojection_error(camera, p_c + d, 0, 0, 0) -
                                     reprojection_error(camera, p_c - d, 0, 0, 0)) /
                                    2e-6;
    EXPECT_LT((J.col(k) - numeric).norm(), 1e-5 * (1 + J.col(k).norm()));
  }
}

TEST_P(ReprojectionGradient, RelativePoseAndMotion) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  const Rigid3 T_w_a = plus(Rigid3(), random.increment(1.0, 5.0));
  const Rigid3 T_a_b = plus(Rigid3(), random.increment(0.5, 2.0));
  for (const double error : {0.0, 0.01, 0.5}) {
    const Rigid3 T_w_b = plus(T_w_a * T_a_b, random.increment(error, error));
    expect_right_gradient(RelativePoseCost(T_a_b, 1.7), T_w_a, as_block(T_w_b));
    const MotionTerm motion{0, 1, T_a_b, 0.3, 0.02};
    const Rigid3 T_b_w = T_w_b.inverse();
    expect_right_gradient(MotionCost(motion), T_a_b * T_b_w, as_block(T_b_w));
    expect_right_gradient(MotionCost(motion), T_w_a.inverse(), as_block(T_b_w));
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, ReprojectionGradient, ::testing::Range(1, 9));

TEST(InverseDepth, IsContinuousWithItsSlope) {
  const InverseDepth above(kMinDepth + 1e-9);
  const InverseDepth below(kMinDepth - 1e-9);
  EXPECT_NEAR(above.value, below.value, 1e-5);
  EXPECT_NEAR(above.derivative, below.derivative, 1e-4);
  EXPECT_DOUBLE_EQ(InverseDepth(4.0).value, 0.25);
}

TEST(RelativePoseCost, IsZeroForAgreeingPosesAndWeighsWhatIsLeft) {
  Random random(3);
  const Rigid3 T_w_a = plus(Rigid3(), random.increment(1, 3));
  const Rigid3 T_a_b = plus(Rigid3(), random.increment(1, 3));
  const Rigid3 T_w_b = T_w_a * T_a_b;
  const PoseBlock a = to_block(T_w_a), b = to_block(T_w_b);
  const double* agreeing[] = {a.data(), b.data()};
  Vector6d residual;
  RelativePoseCost(T_a_b, 2).Evaluate(agreeing, residual.data(), nullptr);
  EXPECT_LT(residual.norm(), 1e-12);
  // b turned by 0.1 rad about its own y axis and moved 0.5 m along its z axis.
  const PoseBlock moved =
      to_block(T_w_b * Rigid3(so3_exp({0, 0.1, 0}), Eigen::Vector3d(0, 0, 0.5)));
  const double* apart[] = {a.data(), moved.data()};
  RelativePoseCost(T_a_b, 2).Evaluate(apart, residual.data(), nullptr);
  EXPECT_NEAR(residual[1], 0.2, 1e-12);
  EXPECT_NEAR(residual[5], 1.0, 1e-12);
}

}  // namespace
}  // namespace kys_slam::test
