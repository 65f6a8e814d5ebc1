// SPDX-License-Identifier: BSD-3-Clause
#include "system/object_log.h"

#include <gtest/gtest.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

namespace kys_slam {
namespace {

/// A car at (0, 1, 15) m before a camera that stands; it drives away at 8 m/s, compared over two
/// frames of 0.1 s.
InstanceState car(int frame) {
  InstanceState state;
  state.instance = 65540;
  state.label = 2;
  state.p_static = 0.1;
  state.keypoints = 40;
  state.matches = 30;
  state.span = 0.2;
  state.motion.matches = 30;
  state.motion.inliers = 25;
  state.motion.centre = {0, 1, 15 + 0.8 * frame};
  state.motion.centre_covariance = Eigen::Matrix3d::Identity() * 0.01;
  state.motion.motion << 0, 0, 0, 0, 0, 1.6;
  state.motion.covariance = Matrix6d::Identity() * 1e-3;
  return state;
}

std::vector<FrameEstimate> poses(int count, const Rigid3& T_w_c) {
  std::vector<FrameEstimate> estimates(static_cast<std::size_t>(count));
  for (FrameEstimate& e : estimates) {
    e.connected = true;
    e.T_w_c = T_w_c;
  }
  return estimates;
}

TEST(ObjectLog, TellsOfThingsInTheFrameOfTheTrajectory) {
  ObjectLog log({});
  for (int k = 0; k < 10; ++k) {
    const std::vector<InstanceState> things = {car(k)};
    log.add(0.1 * k, things);
  }
  const Rigid3 T_w_c(so3_exp({0, 1.2, 0}), Eigen::Vector3d(5, 6, 7));
  const auto objects = log.objects(poses(10, T_w_c));
  ASSERT_EQ(objects.size(), 10u);
  for (const ObjectEstimate& o : objects) {
    EXPECT_EQ(o.instance, 65540);
    EXPECT_EQ(o.keypoints, 40);
    EXPECT_DOUBLE_EQ(o.p_moving, 0.9);
    EXPECT_LT((o.velocity - T_w_c.rotation * Eigen::Vector3d(0, 0, 8)).norm(), 1e-3);
    const Eigen::Vector3d place(0, 1, 15 + 0.8 * static_cast<double>(o.frame));
    EXPECT_LT((o.position - T_w_c * place).norm(), 1e-3);
  }
}

TEST(ObjectLog, LeavesOutWhatStandsIsSmallOrHasNoPose) {
  ObjectOptions options;
  options.min_keypoints = 8;
  ObjectLog log(options);
  for (int k = 0; k < 10; ++k) {
    InstanceState still = car(k), small = car(k), vague = car(k);
    still.instance = 1;
    still.p_static = 0.6;
    small.instance = 2;
    small.keypoints = 7;
    vague.instance = 3;  // no motion that most matches agree on
    vague.motion.centre.x() = 30;
    vague.motion.inliers = 10;
    vague.motion.motion << 0, 0, 0, 50, 0, 0;
    const std::vector<InstanceState> things = {still, small, vague};
    log.add(0.1 * k, things);
  }
  std::vector<FrameEstimate> trajectory = poses(10, Rigid3());
  trajectory[4].connected = false;
  const auto objects = log.objects(trajectory);
  EXPECT_EQ(objects.size(), 9u);
  for (const ObjectEstimate& o : objects) {
    EXPECT_EQ(o.instance, 3);
    EXPECT_NE(o.frame, 4);
    EXPECT_NEAR(o.velocity.x(), 0, 1);  // of its places alone
  }
}

TEST(ObjectLog, AnObjectIsLoggedWhereItIsLessSureOrHasNoDisparity) {
  const auto count = [](double p_static, int keypoints) {
    ObjectLog log({});
    for (int k = 0; k < 10; ++k) {
      InstanceState state = car(k);
      if (k < 2 || k == 9) {
        state.p_static = p_static;
        state.keypoints = keypoints;
        state.motion.centre.x() = 30;  // not believed
      }
      const std::vector<InstanceState> things = {state};
      log.add(0.1 * k, things);
    }
    const auto objects = log.objects(poses(10, Rigid3()));
    for (const ObjectEstimate& o : objects) EXPECT_NEAR(o.position.x(), 0, 0.1) << o.frame;
    return objects.size();
  };
  EXPECT_EQ(count(0.75, 40), 10u);
  EXPECT_EQ(count(0.1, 0), 10u);
  EXPECT_EQ(count(0.85, 40), 7u);
}

// Velocities over two frames share the keypoints of one: two of them say as much as one over one.
TEST(ObjectLog, LongSpansDoNotCountTwice) {
  const auto variance = [](double span, double displacement_variance) {
    ObjectLog log({});
    for (int k = 0; k < 20; ++k) {
      InstanceState state = car(k);
      state.span = span;
      state.motion.motion[5] = 8 * span;
      state.motion.covariance = Matrix6d::Identity() * displacement_variance;
      const std::vector<InstanceState> things = {state};
      log.add(0.1 * k, things);
    }
    return log.objects(poses(20, Rigid3()))[10].velocity_covariance(0, 0);
  };
  // Variance of a velocity: d / span^2, times the frames of the span.
  EXPECT_NEAR(variance(0.4, 4e-3), variance(0.1, 1e-3), 0.3 * variance(0.1, 1e-3));
  EXPECT_GT(variance(0.4, 16e-3), variance(0.1, 1e-3));
}

/// The times are those of the images: one that is repeated shows nothing new.
TEST(ObjectLog, ARepeatedImageDoesNotStopAnObject) {
  ObjectLog log({});
  for (int k = 0; k < 10; ++k) {
    const std::vector<InstanceState> things = {car(k)};
    log.add(0.1 * k, things);
    if (k % 3 != 2) continue;
    InstanceState again = car(k);
    again.span = 0;
    log.add(0.1 * k, std::vector<InstanceState>{again});
  }
  const auto objects = log.objects(poses(13, Rigid3()));
  ASSERT_EQ(objects.size(), 13u);
  int images = 0;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const bool again = i % 4 == 3;
    images += again ? 0 : 1;
    EXPECT_NEAR(objects[i].velocity.z(), 8, 1e-3) << i;
    EXPECT_NEAR(objects[i].position.z(), 15 + 0.8 * (images - 1), 1e-3) << i;
  }
}

TEST(ObjectLog, OptionsAreChecked) {
  ObjectOptions options;
  options.min_probability = 0;
  EXPECT_THROW(check_options(options), InputError);
  options = {};
  options.tracks.max_gap = -1;
  EXPECT_THROW(check_options(options), InputError);
}

}  // namespace
}  // namespace kys_slam
