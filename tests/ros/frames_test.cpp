// SPDX-License-Identifier: BSD-3-Clause
// Frames of REP 103 and REP 105, by examples worked by hand.
#include "frames.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cmath>
#include <numbers>

namespace kys_slam::ros {
namespace {

constexpr double kQuarter = std::numbers::pi / 2;

void expect_near(const Rigid3& a, const Rigid3& b, double tolerance = 1e-12) {
  EXPECT_LT((a.t() - b.t()).norm(), tolerance) << a.t().transpose() << " | " << b.t().transpose();
  EXPECT_LT(rotation_angle(a.inverse() * b), 10 * tolerance + 1e-9);
}

FrameReport tracked(std::int64_t index, const Rigid3& T_w_c) {
  FrameReport report;
  report.index = index;
  report.timestamp = 0.1 * static_cast<double>(index);
  report.status = index == 0 ? FrameStatus::kStarted : FrameStatus::kTracked;
  report.submap = 0;
  report.T_w_c = T_w_c;
  return report;
}

/// With the motion from the frame before as it was measured.
FrameReport moved(std::int64_t index, const Rigid3& T_w_c, const Rigid3& T_last_c) {
  FrameReport report = tracked(index, T_w_c);
  RelativePose& motion = report.motion.emplace();
  motion.other = index - 1;
  motion.T_other_c = T_last_c;
  motion.covariance.setIdentity();
  return report;
}

Rigid3 shift(double x, double y, double z) {
  return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

TEST(Rep103, OpticalAxesAsThoseOfABody) {
  const Rigid3 T = optical_to_body();
  const auto expect = [&](const Eigen::Vector3d& optical, const Eigen::Vector3d& body) {
    EXPECT_LT((T * optical - body).norm(), 1e-12);
  };
  expect({0, 0, 1}, {1, 0, 0});   // forward
  expect({1, 0, 0}, {0, -1, 0});  // right is minus left
  expect({0, 1, 0}, {0, 0, -1});  // down is minus up
  EXPECT_NEAR(T.R().determinant(), 1, 1e-12);
}

TEST(Rep103, ACameraThatLooksDownOrToTheLeft) {
  const Eigen::Vector3d ahead(0, 0, 1);
  EXPECT_LT(
      (base_from_camera({1, 2, 3}, {0, kQuarter, 0}) * ahead - Eigen::Vector3d(1, 2, 2)).norm(),
      1e-12);
  EXPECT_LT(
      (base_from_camera({1, 2, 3}, {0, 0, kQuarter}) * ahead - Eigen::Vector3d(1, 3, 3)).norm(),
      1e-12);
  // Rolled to the right by a quarter: its right side is down.
  const Rigid3 rolled = base_from_camera({0, 0, 0}, {kQuarter, 0, 0});
  EXPECT_LT((rolled * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 0, -1)).norm(), 1e-12);
}

TEST(Rep103, ATransformOfRosIsCheckedBeforeItCounts) {
  const double h = std::sqrt(0.5);
  // A quarter about z: x becomes y.
  const Rigid3 T = rigid_of({1, 2, 3}, {0, 0, h, h});
  EXPECT_LT((T * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-12);
  // The optical frame as robot descriptions have it: roll -90, yaw -90 degrees.
  expect_near(rigid_of({0, 0, 0}, {-0.5, 0.5, -0.5, 0.5}), optical_to_body());
  expect_near(rigid_of({0, 0, 0}, {0, 0, 0, 1.0005}), {});
  EXPECT_THROW(rigid_of({0, 0, 0}, {0, 0, 0, 0}), InputError);
  EXPECT_THROW(rigid_of({0, 0, 0}, {0, 0, 0, 1.01}), InputError);
  EXPECT_THROW(rigid_of({std::nan(""), 0, 0}, {0, 0, 0, 1}), InputError);
  EXPECT_THROW(rigid_of({0, 0, 0}, {0, 0, 0, HUGE_VAL}), InputError);
}

TEST(Rep105, ForwardIsXAndUpIsZ) {
  Rep105Frames frames(base_from_camera({0, 0, 0}, {0, 0, 0}));
  expect_near(frames.add(tracked(0, {}))->T_map_base, {});
  // 2 m forward, 1 m to the right, 0.5 m down, turned to the left by 0.3 rad.
  const Rigid3 T_w_c(so3_exp({0, -0.3, 0}), {1, 0.5, 2});
  const FramePoses poses = *frames.add(moved(1, T_w_c, T_w_c));
  const Rigid3 expected(so3_exp({0, 0, 0.3}), {2, -1, -0.5});
  expect_near(poses.T_map_base, expected);
  expect_near(poses.T_odom_base, expected);
  expect_near(poses.T_map_odom, {});
}

/// A camera 1 m before base_link: when the camera turns to the left on its place by a quarter,
/// base_link swings to the right of it.
TEST(Rep105, BaseLinkBehindTheCamera) {
  Rep105Frames frames(base_from_camera({1, 0, 0}, {0, 0, 0}));
  expect_near(frames.add(tracked(0, {}))->T_map_base, {});
  const Rigid3 turn(so3_exp({0, -kQuarter, 0}), {0, 0, 0});
  expect_near(frames.add(moved(1, turn, turn))->T_map_base,
              {so3_exp({0, 0, kQuarter}), {1, -1, 0}});
}

/// A loop moves the map by 0.4 m to the right between two frames 1 m apart.
TEST(Rep105, ALoopCorrectsMapToOdomAlone) {
  Rep105Frames frames(optical_to_body());
  frames.add(tracked(0, {}));
  frames.add(moved(1, shift(0, 0, 1), shift(0, 0, 1)));
  const FramePoses poses = *frames.add(moved(2, shift(0.4, 0, 2), shift(0, 0, 1)));
  expect_near(poses.T_odom_base, shift(2, 0, 0));
  expect_near(poses.T_map_base, shift(2, -0.4, 0));
  expect_near(poses.T_map_odom, shift(0, -0.4, 0));
}

TEST(Rep105, OdomStaysWhileLostAndGoesOnAfterRelocalisation) {
  Rep105Frames frames(optical_to_body());
  frames.add(tracked(0, {}));
  frames.add(moved(1, shift(0, 0, 1), shift(0, 0, 1)));
  FrameReport lost = tracked(2, {});
  lost.status = FrameStatus::kLost;
  EXPECT_FALSE(frames.add(lost));
  FrameReport found = tracked(3, shift(0, 0, 4));
  found.relocalised = true;
  const FramePoses poses = *frames.add(found);
  expect_near(poses.T_odom_base, shift(1, 0, 0));
  expect_near(poses.T_map_odom, shift(3, 0, 0));
  EXPECT_FALSE(poses.twist);
  const FramePoses next = *frames.add(moved(4, shift(0, 0, 5), shift(0, 0, 1)));
  expect_near(next.T_odom_base, shift(2, 0, 0));
  expect_near(next.T_map_base, shift(5, 0, 0));
}

/// A sub-map that is not connected goes on where the last pose was; when it is merged, the poses
/// are those of the first map.
TEST(Rep105, ASubMapAndItsMerge) {
  Rep105Frames frames(optical_to_body());
  frames.add(tracked(0, {}));
  frames.add(moved(1, shift(0, 0, 1), shift(0, 0, 1)));
  FrameReport started = tracked(5, {});  // its world begins with it
  started.status = FrameStatus::kStarted;
  started.submap = 7;
  const FramePoses at_start = *frames.add(started);
  expect_near(at_start.T_map_base, shift(1, 0, 0));
  expect_near(at_start.T_odom_base, shift(1, 0, 0));
  FrameReport next = moved(6, shift(0, 0, 1), shift(0, 0, 1));
  next.submap = 7;
  expect_near(frames.add(next)->T_map_base, shift(2, 0, 0));
  FrameReport merged = moved(7, shift(0, 0, 9), shift(0, 0, 1));  // in the world of the first
  const FramePoses poses = *frames.add(merged);
  expect_near(poses.T_map_base, shift(9, 0, 0));
  expect_near(poses.T_odom_base, shift(3, 0, 0));
  expect_near(poses.T_map_odom, shift(6, 0, 0));
}

/// The map of a loaded file keeps its origin.
TEST(Rep105, AFrameFoundInALoadedMap) {
  Rep105Frames frames(optical_to_body());
  FrameReport found = tracked(0, shift(0, 0, 20));
  found.status = FrameStatus::kTracked;
  found.relocalised = true;
  const FramePoses poses = *frames.add(found);
  expect_near(poses.T_odom_base, {});
  expect_near(poses.T_map_odom, shift(20, 0, 0));
}

TEST(Rep105, CovarianceInTheAxesAndTheOrderOfRos) {
  Rep105Frames frames(optical_to_body());
  FrameReport first = tracked(0, {});
  RelativePose& local = first.local.emplace();
  local.covariance.setZero();
  // rad^2 and m^2 about and along x right, y down, z forward.
  local.covariance.diagonal() << 1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.09;
  const FramePoses poses = *frames.add(first);
  const double expected[] = {0.09, 0.01, 0.02, 3e-4, 1e-4, 2e-4};  // x, y, z, about x, y, z
  for (std::size_t i = 0; i < 36; ++i) {
    EXPECT_NEAR(poses.covariance[i], i % 7 == 0 ? expected[i / 7] : 0, 1e-12) << i;
  }
}

/// The yaw of the camera is uncertain by 0.1 rad; base_link is 2 m behind it, so that it is
/// uncertain by 0.2 m to the side.
TEST(Rep105, CovarianceOfABaseLinkBehindTheCamera) {
  RelativePose camera;
  camera.covariance.setZero();
  camera.covariance(1, 1) = 0.01;  // about y, down
  const RelativePose base = of_base(camera, base_from_camera({2, 0, 0}, {0, 0, 0}));
  RelativePose::Covariance expected = RelativePose::Covariance::Zero();
  expected(2, 2) = 0.01;
  expected(4, 4) = 0.04;
  // To the left by positive yaw about the camera, base_link goes to the right.
  expected(2, 4) = expected(4, 2) = -0.02;
  EXPECT_LT((base.covariance - expected).norm(), 1e-12);
}

/// The increment of the camera's pose shown as one of base_link: T_c exp(d) T_c_b, by differences.
TEST(Rep105, CovarianceOfBaseLinkByDifferences) {
  const Rigid3 T_b_c = base_from_camera({0.7, -0.2, 1.1}, {0.1, 0.2, -0.4});
  RelativePose camera;
  camera.T_other_c = Rigid3(so3_exp({0.2, -0.1, 0.3}), {0.5, 0.1, 1});
  camera.covariance.setZero();
  constexpr double kSmall = 1e-6;
  RelativePose::Covariance expected = RelativePose::Covariance::Zero();
  for (int k = 0; k < 6; ++k) {
    Eigen::Matrix<double, 6, 1> d = Eigen::Matrix<double, 6, 1>::Zero();
    d[k] = kSmall;
    const double variance = 1 + k;
    camera.covariance(k, k) = variance;
    const Rigid3 off = T_b_c * Rigid3(so3_exp(d.head<3>()), d.tail<3>()) * T_b_c.inverse();
    Eigen::Matrix<double, 6, 1> shown;
    shown << so3_log(off.rotation) / kSmall, off.t() / kSmall;
    expected += variance * shown * shown.transpose();
  }
  const RelativePose base = of_base(camera, T_b_c);
  EXPECT_LT((base.covariance - expected).norm(), 1e-4);
  expect_near(base.T_other_c * T_b_c, T_b_c * camera.T_other_c);
}

TEST(Rep105, TwistInBaseLink) {
  Rep105Frames frames(base_from_camera({1, 0, 0}, {0, 0, 0}));
  frames.add(tracked(0, {}));
  // base_link turns on its place by 0.2 rad/s to the left: the camera goes on a circle of 1 m.
  const Rigid3 T_b_c = base_from_camera({1, 0, 0}, {0, 0, 0});
  const Rigid3 motion = T_b_c.inverse() * Rigid3(so3_exp({0, 0, 0.02}), {0, 0, 0}) * T_b_c;
  const FramePoses poses = *frames.add(moved(1, motion, motion));
  ASSERT_TRUE(poses.twist);
  EXPECT_LT((poses.twist->angular - Eigen::Vector3d(0, 0, 0.2)).norm(), 1e-9);
  EXPECT_LT(poses.twist->linear.norm(), 1e-9);
}

}  // namespace
}  // namespace kys_slam::ros
