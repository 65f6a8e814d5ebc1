// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/motion_term.h"

#include <gtest/gtest.h>

#include "geometry/so3.h"

namespace kys_slam {
namespace {

using Vector6d = MotionNormal::Vector6d;

/// 0.2 m or 0.02 rad more than expected, twice the sigma: 1/2 of 4.
TEST(MotionTerm, CostsHalfItsChiSquare) {
  const MotionTerm term{0, 1, Rigid3(Eigen::Quaterniond::Identity(), {0, 0, -1}), 0.1, 0.01};
  const Rigid3 T_b_w(so3_exp({0.1, -0.2, 0.3}), {4, 5, 6});
  EXPECT_NEAR(cost_of(term, term.T_a_b * T_b_w, T_b_w), 0, 1e-20);
  const Rigid3 farther(Eigen::Quaterniond::Identity(), {0, 0, -1.2});
  EXPECT_NEAR(cost_of(term, farther * T_b_w, T_b_w), 2, 1e-9);
  const Rigid3 turned(so3_exp({0, 0.02, 0}), Eigen::Vector3d::Zero());
  EXPECT_NEAR(cost_of(term, turned * term.T_a_b * T_b_w, T_b_w), 2, 1e-9);
}

TEST(MotionTerm, NormalEquationsAreThoseOfTheCost) {
  const MotionTerm term{0, 1, Rigid3(so3_exp({0.2, 0.1, -0.3}), {0.3, -0.2, -1}), 0.05, 0.01};
  const Rigid3 T_b_w(so3_exp({0.5, -0.2, 0.3}), {4, 5, 6});
  const Rigid3 more(so3_exp({2e-3, -1e-3, 1.5e-3}), {0.03, 0.02, -0.04});
  const Rigid3 T_a_w = more * term.T_a_b * T_b_w;
  const MotionNormal normal = normal_of(term, T_a_w, T_b_w);
  constexpr double kStep = 1e-5;
  const auto moved = [](const Rigid3& T, int k, double by) {
    Vector6d step = Vector6d::Zero();
    step[k] = by;
    return plus_left(T, step);
  };
  const auto slope = [&](int k, bool of_a) {
    const auto at = [&](double by) {
      return of_a ? cost_of(term, moved(T_a_w, k, by), T_b_w)
                  : cost_of(term, T_a_w, moved(T_b_w, k, by));
    };
    return (at(kStep) - at(-kStep)) / (2 * kStep);
  };
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(normal.a[k], slope(k, true), 3e-3 * normal.a.norm()) << k;
    EXPECT_NEAR(normal.b[k], slope(k, false), 3e-3 * normal.b.norm()) << k;
  }
  // At the expected motion the Gauss-Newton matrix is the curvature: a step of both poses costs
  // 1/2 step^T H step.
  const Rigid3 T_a_expected = term.T_a_b * T_b_w;
  const MotionNormal at = normal_of(term, T_a_expected, T_b_w);
  Vector6d a, b;
  a << 1e-4, -2e-4, 3e-4, 1e-3, 2e-3, -1e-3;
  b << -2e-4, 1e-4, 1e-4, -2e-3, 1e-3, 1e-3;
  const double expected = 0.5 * (a.dot(at.aa * a) + 2 * a.dot(at.ab * b) + b.dot(at.bb * b));
  EXPECT_NEAR(cost_of(term, plus_left(T_a_expected, a), plus_left(T_b_w, b)), expected,
              5e-3 * expected);
}

}  // namespace
}  // namespace kys_slam
