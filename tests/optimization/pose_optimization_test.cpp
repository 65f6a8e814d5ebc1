// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_optimization.h"

#include <gtest/gtest.h>

#include "synthetic_scene.h"

namespace kys_slam::test {
namespace {

const Rigid3 kTruth(so3_exp({0.05, -0.4, 0.02}), {1.5, -0.3, 12});

double distance(const Rigid3& a, const Rigid3& b) {
  return minus(a, b).norm();
}

TEST(OptimizePose, RecoversAPerturbedPoseFromExactObservations) {
  const auto frame = make_frame(kTruth, 200, 0, 0.3, 1);
  Random random(2);
  const auto result =
      optimize_pose(kitti_camera(), plus(kTruth, random.increment(0.02, 0.3)), frame);
  EXPECT_LT(distance(result.T_c_w, kTruth), 2e-6);  // observations are rounded to float
  EXPECT_EQ(result.inliers, 200);
}

TEST(OptimizePose, WorksWithMonocularObservationsAlone) {
  const auto frame = make_frame(kTruth, 100, 0, 1.0, 1);
  Random random(2);
  const auto result =
      optimize_pose(kitti_camera(), plus(kTruth, random.increment(0.01, 0.2)), frame);
  EXPECT_LT(distance(result.T_c_w, kTruth), 2e-5);
}

TEST(OptimizePose, FlagsExactlyTheOutliers) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    auto frame = make_frame(kTruth, 300, 0.3, 0.3, seed);
    Random random(seed + 100);
    std::vector<std::uint8_t> wrong(frame.size(), 0);
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (random.uniform(0, 1) > 0.3) continue;
      wrong[i] = 1;
      const double direction = random.uniform(0, 2 * M_PI);
      const double length = random.uniform(25, 80);
      frame[i].u += static_cast<float>(length * std::cos(direction));
      frame[i].v += static_cast<float>(length * std::sin(direction));
    }
    const auto result =
        optimize_pose(kitti_camera(), plus(kTruth, random.increment(0.01, 0.1)), frame);
    EXPECT_EQ(result.outlier, wrong) << "seed " << seed;
    EXPECT_LT(distance(result.T_c_w, kTruth), 0.02) << "seed " << seed;
  }
}

TEST(OptimizePose, InformationIsTheInverseOfTheScatter) {
  // Mahalanobis distance of the error, averaged over trials, is the degrees of freedom.
  double sum = 0;
  constexpr int kTrials = 200;
  PoseOptions options;
  options.chi2_mono = options.chi2_stereo = 1e6;  // no outliers: plain least squares
  for (int i = 0; i < kTrials; ++i) {
    const auto frame = make_frame(kTruth, 100, 1.0, 0.3, 1000 + i);
    const auto result = optimize_pose(kitti_camera(), kTruth, frame, options);
    const auto error = minus(result.T_c_w, kTruth);
    sum += error.dot(result.information * error);
  }
  EXPECT_NEAR(sum / kTrials, 6.0, 0.6);
}

TEST(OptimizePose, InformationMatchesNumericDifferences) {
  auto frame = make_frame(kTruth, 50, 0, 0.3, 4);
  for (std::size_t i = 0; i < frame.size(); i += 2) frame[i].ratio = {2, 5};
  const auto result = optimize_pose(kitti_camera(), kTruth, frame);
  const StereoCamera camera = kitti_camera();
  Eigen::Matrix<double, 6, 6> expected = Eigen::Matrix<double, 6, 6>::Zero();
  for (const auto& o : frame) {
    Eigen::Matrix<double, 3, 6> J;
    for (int k = 0; k < 6; ++k) {
      Eigen::Matrix<double, 6, 1> d = Eigen::Matrix<double, 6, 1>::Zero();
      d[k] = 1e-6;
      J.col(k) = (camera.project_stereo(plus(result.T_c_w, d) * o.p_w) -
                  camera.project_stereo(plus(result.T_c_w, -d) * o.p_w)) /
                 2e-6;
    }
    J.row(2) = J.row(0) - J.row(2);  // of the disparity
    if (std::isnan(o.u_right)) J.row(2).setZero();
    const Eigen::Vector3d weights(1, o.ratio.v, o.ratio.disparity);
    expected += J.transpose() * weights.asDiagonal() * J * o.inv_sigma * o.inv_sigma;
  }
  EXPECT_LT((result.information - expected).norm(), 1e-6 * expected.norm());
}

TEST(OptimizePose, ErrorsWeighRowsAndDisparitiesByTheirRatio) {
  // 10 m ahead: 1 px is 10 m / fx. The error is (1, 2, 3) px at a deviation of 2 px:
  // chi2 = (1 + 2 * 4 + 5 * 9) / 4 = 13.5.
  const StereoCamera camera = kitti_camera();
  PoseObservation o;
  o.p_w = {0, 0, 10};
  o.u = static_cast<float>(camera.cx - 1);
  o.v = static_cast<float>(camera.cy - 2);
  o.u_right = static_cast<float>(o.u - (camera.bf() / 10 - 3));
  o.inv_sigma = 0.5f;
  o.ratio = {2, 5};
  std::vector<double> errors;
  PoseErrors(camera, std::span(&o, 1), {}).at(Rigid3(), errors);
  EXPECT_NEAR(errors.at(0), 13.5 / kChi2Stereo95, 1e-4);
  o.u_right = kNoRight;  // (1 + 2 * 4) / 4
  PoseErrors(camera, std::span(&o, 1), {}).at(Rigid3(), errors);
  EXPECT_NEAR(errors.at(0), 2.25 / kChi2Mono95, 1e-4);
}

TEST(OptimizePose, PointsBehindTheCameraAndNonFiniteOnesAreOutliers) {
  auto frame = make_frame(kTruth, 60, 0, 0.3, 1);
  const float inf = std::numeric_limits<float>::infinity();
  frame[0].p_w = kTruth.inverse() * Eigen::Vector3d(0.1, 0.2, -3);
  frame[1].p_w.x() = std::numeric_limits<double>::quiet_NaN();
  frame[2].u = inf;
  frame[3].v = kNoRight;
  frame[4].inv_sigma = 0;
  frame[5].u_right = inf;
  frame[6].p_w.setConstant(1e300);
  frame[7].inv_sigma = kNoRight;
  const auto result = optimize_pose(kitti_camera(), kTruth, frame);
  for (std::size_t i = 0; i < frame.size(); ++i) EXPECT_EQ(result.outlier[i], i < 8 ? 1 : 0) << i;
  EXPECT_EQ(result.inliers, 52);
  EXPECT_LT(distance(result.T_c_w, kTruth), 2e-6);
}

TEST(OptimizePose, TooFewObservationsLeaveThePoseAlone) {
  const auto start = plus(kTruth, Eigen::Matrix<double, 6, 1>::Constant(0.01));
  for (const int count : {0, 1, 2}) {
    const auto frame = make_frame(kTruth, count, 0, 0, 1);
    const auto result = optimize_pose(kitti_camera(), start, frame);
    EXPECT_EQ(minus(result.T_c_w, start).norm(), 0);
    EXPECT_EQ(result.inliers, 0);
    EXPECT_EQ(result.outlier, std::vector<std::uint8_t>(frame.size(), 1));
  }
}

TEST(OptimizePose, NonFiniteStartIsGivenBackWithoutInliers) {
  Rigid3 start = kTruth;
  start.translation.x() = std::numeric_limits<double>::quiet_NaN();
  const auto frame = make_frame(kTruth, 20, 0, 0, 1);
  EXPECT_EQ(optimize_pose(kitti_camera(), start, frame).inliers, 0);
}

TEST(OptimizePose, SameInputSameBytes) {
  const auto frame = make_frame(kTruth, 301, 1.0, 0.3, 9);
  const auto start = plus(kTruth, Eigen::Matrix<double, 6, 1>::Constant(0.01));
  const auto a = optimize_pose(kitti_camera(), start, frame);
  const auto b = optimize_pose(kitti_camera(), start, frame);
  EXPECT_EQ(a.T_c_w.rotation.coeffs(), b.T_c_w.rotation.coeffs());
  EXPECT_EQ(a.T_c_w.translation, b.T_c_w.translation);
  EXPECT_EQ(a.outlier, b.outlier);
}

}  // namespace
}  // namespace kys_slam::test
