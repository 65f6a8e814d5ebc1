// SPDX-License-Identifier: BSD-3-Clause
#include "motion/instance_motion.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>
#include <vector>

#include "geometry/reprojection.h"
#include "map/frame_features.h"

namespace kys_slam {
namespace {

const StereoCamera kCamera{1241, 376, 720, 720, 610, 185, 0.54};

/// Points on a body, seen before and after the camera moved by T_now_before and the body by
/// `motion` about `centre` (camera now).
class Body {
 public:
  Body(int points, const Eigen::Vector3d& centre, unsigned seed) : centre_(centre), random_(seed) {
    std::uniform_real_distribution<double> side(-1, 1);
    for (int i = 0; i < points; ++i) {
      points_.push_back(centre + Eigen::Vector3d(side(random_), side(random_), 2 * side(random_)));
    }
  }

  std::vector<InstanceMatch> matches(const Rigid3& T_now_before, const Vector6d& motion,
                                     double sigma) {
    std::vector<InstanceMatch> all;
    const Rigid3 T_before_now = T_now_before.inverse();
    for (const Eigen::Vector3d& q : points_) {
      const Eigen::Vector3d x =
          centre_ + so3_exp(motion.head<3>()) * (q - centre_) + motion.tail<3>();
      all.push_back({see(T_before_now * q, sigma), see(x, sigma)});
    }
    return all;
  }

 private:
  StereoPixel see(const Eigen::Vector3d& p, double sigma) {
    std::normal_distribution<double> noise(0, sigma);
    const Eigen::Vector3d pixel = kCamera.project_stereo(p);
    const double u = pixel.x() + (sigma > 0 ? noise(random_) : 0);
    const double d = pixel.x() - pixel.z() + (sigma > 0 ? noise(random_) : 0);
    const double v = pixel.y() + (sigma > 0 ? noise(random_) : 0);
    return {static_cast<float>(u), static_cast<float>(v), static_cast<float>(u - d),
            1.0f / kPixelSigma};
  }

  Eigen::Vector3d centre_;
  std::mt19937 random_;
  std::vector<Eigen::Vector3d> points_;
};

CameraMotion ahead(double metres) {
  CameraMotion ego;
  ego.T_now_before.rotation = so3_exp({0.002, 0.01, -0.001});
  ego.T_now_before.translation = {0.01, 0, -metres};
  ego.covariance.diagonal() << 1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6;
  return ego;
}

const MotionRange kCar{1.0, 0.05};  // a tenth of a second

TEST(InstanceMotion, FindsTheMotionItWasGiven) {
  Body body(40, {2, 0.5, 12}, 1);
  Vector6d truth;
  truth << 0, 0.03, 0, 0.1, 0, 0.7;
  const CameraMotion ego = ahead(0.8);
  const InstanceMotion found =
      estimate_instance_motion(kCamera, body.matches(ego.T_now_before, truth, 0.1), ego, kCar, {});
  EXPECT_EQ(found.matches, 40);
  EXPECT_GT(found.inliers, 36);
  EXPECT_LT(found.log_ratio, -50);
  // The centre found is not that of the truth: compare where points go.
  const Eigen::Vector3d before = found.centre - found.motion.tail<3>();
  const Eigen::Vector3d c(2, 0.5, 12);
  const Eigen::Vector3d should =
      c + so3_exp(truth.head<3>()) * (before - c) + truth.tail<3>() - before;
  EXPECT_LT((found.motion.tail<3>() - should).norm(), 0.06);
  EXPECT_NEAR(found.motion[1], 0.03, 0.01);
  EXPECT_TRUE(found.rotation_observed);
  const Eigen::Vector3d sigma = found.covariance.diagonal().tail<3>().cwiseSqrt();
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(std::abs(found.motion[3 + i] - should[i]), 4 * sigma[i]) << i;
  }
}

TEST(InstanceMotion, TellsStillFromMoving) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const CameraMotion ego = ahead(0.8);
    Vector6d moves = Vector6d::Zero();
    moves.tail<3>() << 0.15, 0, 0.3;
    Body body(15, {-3, 0.5, 10}, seed);
    EXPECT_GT(estimate_instance_motion(
                  kCamera, body.matches(ego.T_now_before, Vector6d::Zero(), 0.15), ego, kCar, {})
                  .log_ratio,
              2)
        << seed;
    EXPECT_LT(estimate_instance_motion(kCamera, body.matches(ego.T_now_before, moves, 0.15), ego,
                                       kCar, {})
                  .log_ratio,
              -5)
        << seed;
  }
}

TEST(InstanceMotion, AUncertainCameraSaysLess) {
  Body body(20, {-3, 0.5, 10}, 3);
  CameraMotion ego = ahead(0.8);
  Vector6d moves = Vector6d::Zero();
  moves.tail<3>() << 0, 0, 0.2;
  const std::vector<InstanceMatch> matches = body.matches(ego.T_now_before, moves, 0.1);
  const double certain = estimate_instance_motion(kCamera, matches, ego, kCar, {}).log_ratio;
  ego.covariance *= 1e5;  // 0.3 m
  const double uncertain = estimate_instance_motion(kCamera, matches, ego, kCar, {}).log_ratio;
  EXPECT_LT(certain, -10);
  EXPECT_GT(uncertain, -1);
}

TEST(InstanceMotion, AFewWrongMatchesDecideNothing) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Body body(24, {3, 0, 14}, seed);
    const CameraMotion ego = ahead(1);
    std::vector<InstanceMatch> matches = body.matches(ego.T_now_before, Vector6d::Zero(), 0.1);
    for (std::size_t i = 0; i < 6; ++i) {
      matches[i].now.u += 12.0f + static_cast<float>(i);
      matches[i].now.u_right += 9.0f;
    }
    const InstanceMotion found = estimate_instance_motion(kCamera, matches, ego, kCar, {});
    EXPECT_GT(found.log_ratio, 2) << seed;
    EXPECT_GE(found.inliers, 15) << seed;
    EXPECT_LT(found.motion.tail<3>().norm(), 0.15) << seed;
  }
}

TEST(InstanceMotion, TooFewMatchesSayNothing) {
  Body body(3, {3, 0, 14}, 1);
  const CameraMotion ego = ahead(1);
  std::vector<InstanceMatch> matches = body.matches(ego.T_now_before, Vector6d::Zero(), 0.1);
  EXPECT_EQ(estimate_instance_motion(kCamera, matches, ego, kCar, {}).log_ratio, 0);
  EXPECT_EQ(estimate_instance_motion(kCamera, {}, ego, kCar, {}).log_ratio, 0);
  matches.push_back(matches[0]);
  matches.back().before.u_right = std::numeric_limits<float>::quiet_NaN();
  const InstanceMotion found = estimate_instance_motion(kCamera, matches, ego, kCar, {});
  EXPECT_EQ(found.matches, 3);
  EXPECT_EQ(found.log_ratio, 0);
}

/// The ratio against the definition: stacked Gaussians N(0, S + J P J^T) with dense matrices, for
/// errors so small that everything is linear.
TEST(InstanceMotion, RatioIsThatOfTheStackedGaussians) {
  Body body(6, {1, 0, 10}, 7);
  CameraMotion ego = ahead(0.5);
  ego.covariance.diagonal() << 1e-7, 2e-7, 1e-7, 1e-5, 2e-5, 4e-5;
  const std::vector<InstanceMatch> matches = body.matches(ego.T_now_before, Vector6d::Zero(), 0.02);
  const MotionRange small{0.02, 0.002};
  InstanceMotionOptions options;
  options.max_chi2 = 1e6;
  options.iterations = 20;
  const double ratio = estimate_instance_motion(kCamera, matches, ego, small, options).log_ratio;

  const auto n = static_cast<Eigen::Index>(3 * matches.size());
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(n, n);
  Eigen::MatrixXd J(n, 6);
  Eigen::VectorXd e(n);
  std::vector<Eigen::Vector3d> still;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const StereoPixel& b = matches[i].before;
    const double z = kCamera.bf() / (b.u - b.u_right);
    still.push_back(ego.T_now_before * kCamera.back_project(b.u, b.v, z));
  }
  Eigen::Vector3d centre;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> x;
    for (const Eigen::Vector3d& q : still) x.push_back(q[axis]);
    std::sort(x.begin(), x.end());
    centre[axis] = x[3];
  }
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(3 * i);
    const StereoPixel& b = matches[i].before;
    const StereoPixel& w = matches[i].now;
    // Error and its derivative by the first measurement, numerically.
    const auto error = [&](double u, double v, double d) {
      const Eigen::Vector3d q = ego.T_now_before * kCamera.back_project(u, v, kCamera.bf() / d);
      return reprojection_error(kCamera, q, w.u, w.v, w.u_right);
    };
    const double d = static_cast<double>(b.u) - b.u_right;
    Eigen::Matrix3d D;
    constexpr double h = 1e-4;
    D.col(0) = (error(b.u + h, b.v, d) - error(b.u - h, b.v, d)) / (2 * h);
    D.col(1) = (error(b.u, b.v + h, d) - error(b.u, b.v - h, d)) / (2 * h);
    D.col(2) = (error(b.u, b.v, d + h) - error(b.u, b.v, d - h)) / (2 * h);
    S.block<3, 3>(at, at) = 0.04 * (D * D.transpose() + Eigen::Matrix3d::Identity());
    const Eigen::Matrix3d P = reprojection_jacobian(kCamera, still[i]);
    J.block<3, 3>(at, 0) = -P * hat(still[i] - centre);
    J.block<3, 3>(at, 3) = P;
    e.segment<3>(at) = error(b.u, b.v, d);
  }
  Matrix6d change = Matrix6d::Identity();
  change.bottomLeftCorner<3, 3>() = -hat(centre);
  Matrix6d P_still = change * ego.covariance * change.transpose();
  Matrix6d P_moves = P_still;
  for (int i = 0; i < 3; ++i) P_moves(i, i) += 0.002 * 0.002;
  for (int i = 3; i < 6; ++i) P_moves(i, i) += 0.02 * 0.02;
  const auto minus_two_log = [&](const Matrix6d& prior) {
    const Eigen::MatrixXd full = S + J * prior * J.transpose();
    return e.dot(full.ldlt().solve(e)) + std::log(full.determinant());
  };
  const double expected = 0.5 * (minus_two_log(P_moves) - minus_two_log(P_still));
  EXPECT_NEAR(ratio, expected, 0.02 * std::abs(expected) + 1e-3);
}

}  // namespace
}  // namespace kys_slam
