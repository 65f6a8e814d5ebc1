// SPDX-License-Identifier: BSD-3-Clause
#include "ceres_reference/cost_functions.h"

#include <gtest/gtest.h>

#include <vector>

#include "geometry/reprojection.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Compares the analytic Jacobians with central differences at the given blocks. Not Ceres' own
/// GradientChecker: it hands out Eigen matrices allocated inside the Ceres library, which must not
/// be freed by code compiled with other alignment (sanitizers, -march=native).
void expect_right_gradient(const ceres::CostFunction& cost, const Vector6d& first,
                           const double* second) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto& sizes = cost.parameter_block_sizes();
  const int rows = cost.num_residuals();
  std::vector<Eigen::VectorXd> x{first, Eigen::Map<const Eigen::VectorXd>(second, sizes[1])};
  std::vector<RowMajor> J{RowMajor(rows, sizes[0]), RowMajor(rows, sizes[1])};
  const double* blocks[] = {x[0].data(), x[1].data()};
  double* jacobians[] = {J[0].data(), J[1].data()};
  Eigen::VectorXd residual(rows);
  ASSERT_TRUE(cost.Evaluate(blocks, residual.data(), jacobians));
  for (std::size_t block = 0; block < 2; ++block) {
    for (int k = 0; k < sizes[block]; ++k) {
      constexpr double kStep = 1e-6;
      const double value = x[block][k];
      Eigen::VectorXd ahead(rows);
      Eigen::VectorXd behind(rows);
      x[block][k] = value + kStep;
      cost.Evaluate(blocks, ahead.data(), nullptr);
      x[block][k] = value - kStep;
      cost.Evaluate(blocks, behind.data(), nullptr);
      x[block][k] = value;
      const Eigen::VectorXd numeric = (ahead - behind) / (2 * kStep);
      EXPECT_LT((J[block].col(k) - numeric).norm(), 1e-6 * (1 + J[block].norm()))
          << "block " << block << ", parameter " << k;
    }
  }
}

class ReprojectionGradient : public ::testing::TestWithParam<int> {};

TEST_P(ReprojectionGradient, MatchesNumericDifferences) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  const StereoCamera camera = kitti_camera();
  const Rigid3 T_c_w = plus(Rigid3(), random.increment(1.0, 5.0));
  // A small increment as within one optimisation, and a large one that needs the full Jacobian.
  for (const double size : {0.0, 1e-5, 0.3}) {
    const Vector6d increment = random.increment(size, size);
    const Eigen::Vector3d p_c(random.uniform(-5, 5), random.uniform(-2, 2), random.uniform(3, 40));
    const Eigen::Vector3d p_w = plus(T_c_w, increment).inverse() * p_c;
    const Eigen::Vector3d observed = camera.project_stereo(p_c) + random.vector(3);
    expect_right_gradient(StereoReprojectionCost(&camera, &T_c_w, observed, 0.7), increment,
                          p_w.data());
    expect_right_gradient(MonoReprojectionCost(&camera, &T_c_w, observed.head<2>(), 0.7), increment,
                          p_w.data());
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

TEST_P(ReprojectionGradient, RelativePose) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  const Rigid3 T_w_a = plus(Rigid3(), random.increment(1.0, 5.0));
  const Rigid3 T_a_b = plus(Rigid3(), random.increment(0.5, 2.0));
  for (const double error : {0.0, 0.01, 0.5}) {
    const Rigid3 T_w_b = plus(T_w_a * T_a_b, random.increment(error, error));
    for (const double size : {0.0, 0.2}) {
      const Vector6d second = random.increment(size, size);
      expect_right_gradient(RelativePoseCost(&T_w_a, &T_w_b, T_a_b, 1.7),
                            random.increment(size, size), second.data());
    }
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
  const Vector6d zero = Vector6d::Zero();
  const double* blocks[] = {zero.data(), zero.data()};
  Vector6d residual;
  RelativePoseCost(&T_w_a, &T_w_b, T_a_b, 2).Evaluate(blocks, residual.data(), nullptr);
  EXPECT_LT(residual.norm(), 1e-12);
  // b turned by 0.1 rad about its own y axis and moved 0.5 m along its z axis.
  const Rigid3 moved = T_w_b * Rigid3(so3_exp({0, 0.1, 0}), Eigen::Vector3d(0, 0, 0.5));
  RelativePoseCost(&T_w_a, &moved, T_a_b, 2).Evaluate(blocks, residual.data(), nullptr);
  EXPECT_NEAR(residual[1], 0.2, 1e-12);
  EXPECT_NEAR(residual[5], 1.0, 1e-12);
}

}  // namespace
}  // namespace kys_slam::test
