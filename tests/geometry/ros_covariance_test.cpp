// SPDX-License-Identifier: BSD-3-Clause
// Covariances in the order and axes of ROS's messages.
#include <gtest/gtest.h>
#include <kys_slam/ros_covariance.h>

#include <cmath>

namespace kys_slam {
namespace {

using Covariance = RelativePose::Covariance;
using Vector6d = Eigen::Matrix<double, 6, 1>;

TEST(RosCovariance, PutsTranslationFirst) {
  Covariance covariance = Covariance::Zero();
  covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  covariance(0, 3) = covariance(3, 0) = 0.5;  // rotation and translation along x
  const RosCovariance ros = ros_order(covariance);
  const double diagonal[] = {4, 5, 6, 1, 2, 3};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(ros[7 * i], diagonal[i]);
  EXPECT_EQ(ros[3], 0.5);
  EXPECT_EQ(ros[18], 0.5);
  EXPECT_EQ(ros[1], 0);
}

/// The error of a camera that looks along x of the world shows along the axes of the world.
TEST(RosCovariance, OfAPoseIsAboutTheAxesOfTheWorld) {
  const Rigid3 T_w_c(so3_exp({0.3, -1.1, 0.4}), {5, -2, 30});
  Covariance root = Covariance::Zero();
  for (int i = 0; i < 36; ++i) root(i / 6, i % 6) = 1e-3 * std::sin(1.7 * i + 0.3);
  const Covariance covariance = root * root.transpose();
  // Columns of the root are errors d that make up the covariance.
  Covariance expected = Covariance::Zero();
  for (int k = 0; k < 6; ++k) {
    const Vector6d d = root.col(k);
    const Rigid3 moved = T_w_c * Rigid3(so3_exp(d.head<3>()), d.tail<3>());
    Vector6d shown;
    shown << moved.translation - T_w_c.translation,
        so3_log(moved.rotation * T_w_c.rotation.conjugate());
    expected += shown * shown.transpose();
  }
  const RosCovariance ros = ros_pose_covariance(covariance, T_w_c);
  for (int i = 0; i < 36; ++i) {
    EXPECT_NEAR(ros[static_cast<std::size_t>(i)], expected(i / 6, i % 6), 1e-12) << i;
  }
}

TEST(RosCovariance, TwistOfAMotionAlongAnArc) {
  // 2 m/s forward and 0.3 rad/s about y for 0.1 s, in small steps.
  constexpr double kSeconds = 0.1;
  Rigid3 T;
  const Rigid3 step(so3_exp({0, 0.3 * kSeconds / 1000, 0}), {0, 0, 2 * kSeconds / 1000});
  for (int i = 0; i < 1000; ++i) T = T * step;
  RelativePose motion{3, T, Covariance::Identity() * 1e-4};
  const auto twist = ros_twist(motion, kSeconds);
  ASSERT_TRUE(twist);
  EXPECT_NEAR((twist->linear - Eigen::Vector3d(0, 0, 2)).norm(), 0, 1e-3);
  EXPECT_NEAR((twist->angular - Eigen::Vector3d(0, 0.3, 0)).norm(), 0, 1e-9);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(twist->covariance[7 * i], 1e-2, 1e-12);
  EXPECT_FALSE(ros_twist(motion, 0));
  EXPECT_FALSE(ros_twist(motion, std::nan("")));
}

}  // namespace
}  // namespace kys_slam
