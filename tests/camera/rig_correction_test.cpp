// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/rig_correction.h>

#include <cmath>

#include "support/rig_samples.h"

namespace kys_slam {
namespace {

using testing::bent_rig;
using testing::kitti_like;
using testing::rig_with;

TEST(RigCorrection, NoneChangesNothing) {
  const RigCorrection none;
  EXPECT_TRUE(none.none());
  const RigCorrection::Ideal ideal = none.pair({100.25f, 50.5f, 90.125f, 50.75f});
  EXPECT_EQ(ideal.u, 100.25);
  EXPECT_EQ(ideal.v, 50.5);
  EXPECT_EQ(ideal.u_right, 90.125);
  EXPECT_EQ(ideal.row, 0.25);
  EXPECT_EQ(none.measured_left(3.5, 4.5), Eigen::Vector2d(3.5, 4.5));
  EXPECT_EQ(none.measured_right(30, 4.5, 20), Eigen::Vector2d(20, 4.5));
}

TEST(RigCorrection, TheOffsetIsAddedToDisparitiesAlone) {
  const RigCorrection rig = RigCorrection::of_offset(kitti_like(), 0.5);
  EXPECT_FALSE(rig.none());
  EXPECT_FALSE(rig.bends());
  const RigCorrection::Ideal ideal = rig.pair({100, 50, 90, 50});
  EXPECT_EQ(ideal.u, 100);
  EXPECT_EQ(ideal.u_right, 89.5);
  EXPECT_EQ(rig.measured_right(100, 50, 89.5), Eigen::Vector2d(90, 50));
}

/// Each by hand, at x = 0.5, y = -0.25 of a camera of f 700 and centre (600, 180).
TEST(RigCorrection, EveryParameterByHand) {
  const StereoCamera camera = kitti_like();
  const float u = 600 + 350, v = 180 - 175, disparity = 70;  // q = 0.1, x_right = 0.4
  const RigCorrection::Measured m{u, v, u - disparity, v};
  const double r2 = 0.5 * 0.5 + 0.25 * 0.25, right_r2 = 0.4 * 0.4 + 0.25 * 0.25;
  struct Case {
    RigParameter parameter;
    double value;
    Eigen::Vector4d change;  // of u, v, disparity, row; px
  };
  const double f = 700;
  const Case cases[] = {
      {RigParameter::kLeftK1,
       1e-3,
       {-f * 1e-3 * r2 * 0.5, f * 1e-3 * r2 * 0.25, -f * 1e-3 * r2 * 0.5, -f * 1e-3 * r2 * 0.25}},
      {RigParameter::kRightK1, 1e-3, {0, 0, f * 1e-3 * right_r2 * 0.4, f * 1e-3 * right_r2 * 0.25}},
      {RigParameter::kRightP2,
       1e-3,
       {0, 0, f * 1e-3 * (right_r2 + 2 * 0.16), -f * 1e-3 * 2 * 0.4 * -0.25}},
      {RigParameter::kYaw, 1e-3, {0, 0, -f * 1e-3 * 0.16, f * 1e-3 * 0.4 * -0.25}},
      {RigParameter::kPitch, 1e-3, {0, 0, f * 1e-3 * 0.4 * -0.25, -f * 1e-3 * 0.0625}},
      {RigParameter::kRoll, 1e-3, {0, 0, -f * 1e-3 * 0.25, f * 1e-3 * 0.4}},
      {RigParameter::kRatio, 1e-3, {0, 0, f * 1e-3 * 0.4, f * 1e-3 * 0.25}},
      {RigParameter::kOffset, 0.5, {0, 0, 0.5, 0}},
      {RigParameter::kRow, 0.5, {0, 0, 0, -0.5}},
      {RigParameter::kBaselineY, 0.01, {0, 0, 0, 0.01 * 70}},
      // d = f (xl - xr) / (1 - 0.4 z); the row is expected at y / (1 - z q).
      {RigParameter::kBaselineZ, 0.01, {0, 0, 70 / (1 - 0.004) - 70, f * 0.25 * 0.001}},
      {RigParameter::kFocal, 0.01, {350 / 1.01 - 350, 175 - 175 / 1.01, 0, 0}},
  };
  for (const Case& c : cases) {
    const RigCorrection rig = rig_with(camera, {{c.parameter, c.value}});
    const RigCorrection::Ideal ideal = rig.pair(m);
    const Eigen::Vector4d change(ideal.u - u, ideal.v - v, ideal.u - ideal.u_right - disparity,
                                 ideal.row);
    EXPECT_LT((change - c.change).norm(), 2e-3)
        << rig_parameter_names()[static_cast<std::size_t>(c.parameter)].name << ": "
        << change.transpose() << " not " << c.change.transpose();
  }
}

TEST(RigCorrection, WhatIsMeasuredComesBack) {
  const StereoCamera camera = kitti_like();
  const RigCorrection rig = bent_rig(camera);
  for (double u = 20; u < camera.width; u += 150) {
    for (double v = 10; v < camera.height; v += 70) {
      for (const double disparity : {0.5, 20.0, 90.0}) {
        const Eigen::Vector2d left = rig.measured_left(u, v);
        const Eigen::Vector2d right = rig.measured_right(u, v, u - disparity);
        EXPECT_LT((rig.left(left.x(), left.y()) - Eigen::Vector2d(u, v)).norm(), 1e-6);
        const RigCorrection::Ideal ideal =
            rig.pair({static_cast<float>(left.x()), static_cast<float>(left.y()),
                      static_cast<float>(right.x()), static_cast<float>(right.y())});
        EXPECT_NEAR(ideal.u, u, 2e-4);  // of pixels in floats
        EXPECT_NEAR(ideal.u_right, u - disparity, 4e-4);
        EXPECT_NEAR(ideal.row, 0, 4e-4);
        // Without its row the point is taken where it is expected.
        const RigCorrection::Ideal expected =
            rig.pair({static_cast<float>(left.x()), static_cast<float>(left.y()),
                      static_cast<float>(right.x()), std::nanf("")});
        EXPECT_NEAR(expected.u_right, u - disparity, 0.01);
        EXPECT_EQ(expected.row, 0);
      }
    }
  }
}

TEST(RigCorrection, DerivativesAreThoseOfThePair) {
  const StereoCamera camera = kitti_like();
  const RigCorrection::Measured m{950.5f, 40.25f, 900.75f, 41};
  const RigCorrection::Jacobian J = bent_rig(camera).jacobian(m);
  const auto values = [&](const RigCorrection& rig) {
    const RigCorrection::Ideal i = rig.pair(m);
    return Eigen::Vector4d(i.u, i.v, i.u - i.u_right, i.row);
  };
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    constexpr double kStep = 1e-5;
    RigCorrection::Parameters above = bent_rig(camera).parameters(), below = above;
    above[k] += kStep;
    below[k] -= kStep;
    const Eigen::Vector4d slope = (values({camera, above}) - values({camera, below})) / (2 * kStep);
    // Of first order in the parameters, which are some per cent.
    EXPECT_LT((J.col(k) - slope).norm(), 0.08 * slope.norm() + 0.03)
        << rig_parameter_names()[static_cast<std::size_t>(k)].name << ": " << J.col(k).transpose()
        << " not " << slope.transpose();
  }
}

TEST(RigCorrection, SigmaGrowsWithTheFieldOfAParameter) {
  RigEstimate estimate(RigCorrection(kitti_like(), RigCorrection::Parameters::Zero()));
  const int yaw = static_cast<int>(RigParameter::kYaw);
  estimate.covariance(yaw, yaw) = 1e-3 * 1e-3;
  // At x_right = 0.5: a disparity of f yaw x^2.
  const Eigen::Vector4d sigma = estimate.sigma({990, 180, 950, 180});
  EXPECT_NEAR(sigma[2], 700 * 1e-3 * 0.25, 1e-6);
  EXPECT_NEAR(sigma[0], 0, 1e-12);
  EXPECT_NEAR(estimate.sigma({640, 180, 600, 180})[2], 0, 1e-9);
}

}  // namespace
}  // namespace kys_slam
