// SPDX-License-Identifier: BSD-3-Clause
// Covariances of poses against the spread of poses that are estimated from drawn observations.
#include "optimization/pose_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "geometry/reprojection.h"
#include "geometry/so3.h"
#include "optimization/pose_optimization.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam {
namespace {

using Matrix6d = PoseCovarianceProblem::Matrix6d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using test::Random;

constexpr double kSigma = 0.3;  // px
constexpr int kPoints = 80;
constexpr int kTrials = 2000;

/// A scene in the frame of its first camera, which is the reference keyframe, and two frames.
struct Geometry {
  StereoCamera camera = test::kitti_camera();
  std::vector<Eigen::Vector3d> points;  // in the reference
  Rigid3 T_a_r{so3_exp({0.004, -0.02, 0.003}), {0.02, -0.01, -0.7}};
  Rigid3 T_b_r{so3_exp({-0.003, -0.035, 0.001}), {0.05, 0.02, -1.5}};

  Geometry() {
    Random random(5);
    while (points.size() < kPoints) {
      const Eigen::Vector3d p = camera.back_project(random.uniform(200, camera.width - 200),
                                                    random.uniform(60, camera.height - 60),
                                                    std::exp(random.uniform(1.8, 3.4)));
      points.push_back(p);
    }
  }
};

Eigen::Matrix3d information_in(const StereoCamera& camera, const Rigid3& T_c_here,
                               const Eigen::Vector3d& p_here, double sigma) {
  const Eigen::Matrix3d D = reprojection_jacobian(camera, T_c_here * p_here) * T_c_here.R();
  return D.transpose() * D / (sigma * sigma);
}

/// (u, v, disparity) with independent noise.
PoseObservation observe(const StereoCamera& camera, const Eigen::Vector3d& p_c, double sigma,
                        Random& random) {
  const Eigen::Vector3d uvr = camera.project_stereo(p_c);
  PoseObservation o;
  o.u = static_cast<float>(uvr.x() + random.normal(sigma));
  o.v = static_cast<float>(uvr.y() + random.normal(sigma));
  o.u_right = static_cast<float>(o.u - (uvr.x() - uvr.z()) + random.normal(sigma));
  return o;
}

/// The landmark as keyframe 0 made it, by its own stereo observation.
Eigen::Vector3d made_from(const StereoCamera& camera, const Eigen::Vector3d& p, Random& random) {
  const PoseObservation o = observe(camera, p, kSigma, random);
  return camera.back_project(o.u, o.v, camera.bf() / (o.u - o.u_right));
}

/// What the optimiser believes: half of the variance is the landmark's.
constexpr double kAssumed = kSigma * 1.4142135623730951;

Rigid3 pose_from(const Geometry& g, const std::vector<Eigen::Vector3d>& landmarks, const Rigid3& T,
                 Random& random) {
  std::vector<PoseObservation> observations;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    PoseObservation o = observe(g.camera, T * g.points[i], kSigma, random);
    o.p_w = landmarks[i];
    o.inv_sigma = static_cast<float>(1 / kAssumed);
    observations.push_back(o);
  }
  PoseOptions options;
  options.chi2_stereo = 1000;  // no outliers
  return optimize_pose(g.camera, T, observations, options).T_c_w;
}

/// The problem of frame b, with frame a before it.
PoseCovarianceProblem problem_of(const Geometry& g, bool with_before) {
  PoseCovarianceProblem problem;
  problem.keyframes = 1;
  Matrix6d noise_before = Matrix6d::Zero();
  const Rigid3 T_r_b = g.T_b_r.inverse();
  const Rigid3 T_a_b = g.T_a_r * T_r_b;
  for (const Eigen::Vector3d& point : g.points) {
    PoseCovarianceProblem::Landmark& l = problem.landmarks.emplace_back();
    l.p = g.T_b_r * point;
    l.weight = information_in(g.camera, Rigid3(), l.p, kAssumed);
    l.noise = 0.5 * l.weight;
    l.first_view = static_cast<std::uint32_t>(problem.views.size());
    l.views = 1;
    problem.views.push_back({0, information_in(g.camera, T_r_b, l.p, kSigma)});
    if (!with_before) continue;
    l.weight_before = information_in(g.camera, T_a_b, l.p, kAssumed);
    Eigen::Matrix<double, 3, 6> L;
    L << -hat(l.p), Eigen::Matrix3d::Identity();
    noise_before += L.transpose() * (0.5 * l.weight_before) * L;
  }
  if (with_before) problem.before = PoseCovarianceProblem::Before{.noise = noise_before};
  return problem;
}

/// Mean of e^T C^-1 e / 6: one when C is the covariance of the errors e. Its standard deviation
/// over kTrials normal errors is sqrt(2 / 6 / kTrials) = 0.013.
class Consistency {
 public:
  explicit Consistency(const Matrix6d& covariance) : factor_(covariance) {}
  void add(const Vector6d& error) {
    sum_ += error.dot(factor_.solve(error)) / 6;
    outer_ += error * error.transpose();
    ++count_;
  }
  void expect_consistent(const Matrix6d& covariance) const {
    EXPECT_NEAR(sum_ / count_, 1, 0.06);
    for (int i = 0; i < 6; ++i) {  // every direction alone: standard deviation 0.032
      EXPECT_NEAR(outer_(i, i) / count_ / covariance(i, i), 1, 0.13) << "of " << i;
    }
  }

 private:
  Eigen::LLT<Matrix6d> factor_;
  double sum_ = 0;
  Matrix6d outer_ = Matrix6d::Zero();
  int count_ = 0;
};

TEST(PoseCovariance, IsThatOfPosesEstimatedFromNoisyLandmarks) {
  const Geometry g;
  const Matrix6d predicted = pose_covariance(problem_of(g, false)).pose;
  Consistency consistency(predicted);
  Random random(11);
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<Eigen::Vector3d> landmarks;
    for (const auto& p : g.points) landmarks.push_back(made_from(g.camera, p, random));
    const Rigid3 found = pose_from(g, landmarks, g.T_b_r, random);
    consistency.add(left_increment(found * g.T_b_r.inverse()));
  }
  consistency.expect_consistent(predicted);
}

TEST(PoseCovariance, OfAMotionLeavesOutWhatBothFramesHaveInCommon) {
  const Geometry g;
  const PoseCovarianceResult result = pose_covariance(problem_of(g, true));
  ASSERT_TRUE(result.motion);
  Consistency consistency(*result.motion);
  const Rigid3 T_b_a = g.T_b_r * g.T_a_r.inverse();
  Random random(12);
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<Eigen::Vector3d> landmarks;
    for (const auto& p : g.points) landmarks.push_back(made_from(g.camera, p, random));
    const Rigid3 a = pose_from(g, landmarks, g.T_a_r, random);
    const Rigid3 b = pose_from(g, landmarks, g.T_b_r, random);
    consistency.add(left_increment(b * a.inverse() * T_b_a.inverse()));
  }
  consistency.expect_consistent(*result.motion);

  // As if the two frames had landmarks of their own: the errors of landmarks count twice.
  PoseCovarianceProblem apart = problem_of(g, true);
  const std::size_t count = apart.landmarks.size();
  for (std::size_t i = 0; i < count; ++i) {
    PoseCovarianceProblem::Landmark copy = apart.landmarks[i];
    copy.weight.setZero();
    copy.noise.setZero();
    apart.landmarks[i].weight_before.setZero();
    apart.landmarks.push_back(copy);
  }
  const PoseCovarianceResult other = pose_covariance(apart);
  EXPECT_GT(other.motion->trace(), 1.5 * result.motion->trace());
  EXPECT_NEAR((other.pose - result.pose).norm() / result.pose.norm(), 0, 1e-9);
}

TEST(PoseCovariance, OfTheMotionSinceTheReferenceIsThatOfThePose) {
  const Geometry g;
  PoseCovarianceProblem problem = problem_of(g, false);
  problem.before = PoseCovarianceProblem::Before{.keyframe = 0};
  const PoseCovarianceResult result = pose_covariance(problem);
  EXPECT_EQ(*result.motion, result.pose);
}

TEST(PoseCovariance, GrowsWhenLandmarksHangOnAnotherKeyframe) {
  const Geometry g;
  PoseCovarianceProblem problem = problem_of(g, false);
  const Matrix6d by_reference = pose_covariance(problem).pose;
  problem.keyframes = 2;
  // Half of the landmarks are seen by keyframe 1 alone, a quarter by both: these tie it to the
  // reference.
  for (std::size_t i = 0; i < problem.views.size(); i += 2) problem.views[i].keyframe = 1;
  std::vector<PoseCovarianceProblem::View> views;
  for (std::size_t i = 0; i < problem.landmarks.size(); ++i) {
    PoseCovarianceProblem::Landmark& l = problem.landmarks[i];
    const PoseCovarianceProblem::View view = problem.views[l.first_view];
    l.first_view = static_cast<std::uint32_t>(views.size());
    views.push_back(view);
    if (i % 4 == 1) views.push_back({1, view.information});
    l.views = static_cast<std::uint32_t>(views.size()) - l.first_view;
  }
  problem.views = views;
  const Matrix6d by_both = pose_covariance(problem).pose;
  EXPECT_GT(by_both.trace(), 1.1 * by_reference.trace());
}

TEST(PoseCovariance, StandsForAsManyLandmarksAsItSays) {
  const Geometry g;
  PoseCovarianceProblem problem = problem_of(g, true);
  const PoseCovarianceResult all = pose_covariance(problem);
  for (std::size_t i = 0; i < problem.landmarks.size(); ++i) {
    problem.landmarks[i].stands_for = i % 2 == 0 ? 2 : 0;
  }
  const PoseCovarianceResult sampled = pose_covariance(problem);
  EXPECT_NEAR(sampled.pose.trace() / all.pose.trace(), 1, 0.25);
  EXPECT_NEAR(sampled.motion->trace() / all.motion->trace(), 1, 0.25);
}

void expect_positive_definite(const Matrix6d& M) {
  ASSERT_TRUE(M.allFinite());
  EXPECT_EQ(M, Matrix6d(M.transpose()));
  EXPECT_EQ(Eigen::LLT<Matrix6d>(M).info(), Eigen::Success);
}

TEST(PoseCovariance, IsPositiveDefiniteWithoutEnoughLandmarks) {
  const Geometry g;
  for (const std::size_t count : {0u, 1u, 2u, 3u, 80u}) {
    for (const bool with_before : {false, true}) {
      PoseCovarianceProblem problem = problem_of(g, with_before);
      problem.landmarks.resize(count);
      const PoseCovarianceResult result = pose_covariance(problem);
      expect_positive_definite(result.pose);
      if (with_before) {
        expect_positive_definite(*result.motion);
      }
    }
  }
}

TEST(PoseCovariance, OfAHeldPoseIsBoundedByItsPrior) {
  const Geometry g;
  constexpr double kPosition = 0.02, kRotation = 0.01;
  for (const std::size_t count : {0u, 1u, 2u, 5u, 80u}) {
    PoseCovarianceProblem problem = problem_of(g, true);
    for (std::size_t i = count; i < problem.landmarks.size(); ++i) {  // the frame before sees all
      problem.landmarks[i].weight.setZero();
      problem.landmarks[i].noise.setZero();
    }
    problem.prior.diagonal() = left_information(kRotation, kPosition);
    problem.prior_error.diagonal() = problem.prior.diagonal().cwiseInverse();
    const PoseCovarianceResult held = pose_covariance(problem);
    // The error of the motion is at most that of the expected motion: prior_error.
    const Matrix6d slack = 1.0001 * problem.prior_error - *held.motion;
    const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(slack, Eigen::EigenvaluesOnly);
    EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-9) << count << " landmarks";
    expect_positive_definite(*held.motion);
  }
}

}  // namespace
}  // namespace kys_slam
