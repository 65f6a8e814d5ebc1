// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/minimise_pose.h"

#include <gtest/gtest.h>

namespace kys_slam::test {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

const Rigid3 kMinimum(so3_exp({0.2, -0.1, 0.3}), {1, -2, 0.5});
const Eigen::Vector3d kPoints[] = {{1, 0, 4}, {-2, 1, 6}, {0, -1, 9}, {3, 2, 5}};

/// Squared distances of four points under T from where kMinimum puts them; `curvature` times the
/// hessian they have.
PoseNormalEquations distances(const Rigid3& T, double curvature) {
  PoseNormalEquations sums{Eigen::Matrix<double, 6, 6>::Zero(), Vector6d::Zero()};
  for (const Eigen::Vector3d& p : kPoints) {
    const Eigen::Vector3d moved = T * p;
    const Eigen::Vector3d e = moved - kMinimum * p;
    Eigen::Matrix<double, 3, 6> J;
    J << -hat(moved), Eigen::Matrix3d::Identity();
    sums.hessian += curvature * J.transpose() * J;
    sums.gradient += J.transpose() * e;
    sums.cost += 0.5 * e.squaredNorm();
  }
  return sums;
}

double distance(const Rigid3& a, const Rigid3& b) {
  return minus(a, b).norm();
}

TEST(MinimisePose, FindsTheMinimum) {
  const Rigid3 found = minimise_pose(Rigid3(), {}, [](const Rigid3& T) { return distances(T, 1); });
  EXPECT_LT(distance(found, kMinimum), 1e-8);
}

// With a third of the true curvature every undamped step is three times too long and makes the cost
// larger: only damping gets nearer.
TEST(MinimisePose, DampsStepsThatAreTooLong) {
  const PoseMinimisation options{.iterations = 200, .cost_tolerance = 0};
  const Rigid3 found =
      minimise_pose(Rigid3(), options, [](const Rigid3& T) { return distances(T, 1.0 / 3); });
  EXPECT_LT(distance(found, kMinimum), 1e-6);
}

TEST(MinimisePose, KeepsTheBestPose) {
  const PoseMinimisation options{.iterations = 1};
  const Rigid3 found =
      minimise_pose(Rigid3(), options, [](const Rigid3& T) { return distances(T, 0.1); });
  EXPECT_EQ(distance(found, Rigid3()), 0);  // its one step was too long
}

// What cannot be solved for does not move the pose.
TEST(MinimisePose, SurvivesWhatIsNotANumber) {
  const Rigid3 found = minimise_pose(kMinimum, {}, [](const Rigid3& T) {
    PoseNormalEquations sums = distances(T, 1);
    sums.gradient[2] = std::nan("");
    return sums;
  });
  EXPECT_EQ(distance(found, kMinimum), 0);
}

}  // namespace
}  // namespace kys_slam::test
