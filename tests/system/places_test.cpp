// SPDX-License-Identifier: BSD-3-Clause
// Loops, kidnapping and sub-maps, through the public interface.
#include <gtest/gtest.h>
#include <kys_slam/system.h>

#include <algorithm>

#include "map/map.h"
#include "support/feature_world.h"
#include "system/private_access.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::ring_length;
using testing::ring_pose;
using testing::weaving_pose;

FeatureWorld::Options noisy() {
  FeatureWorld::Options options;
  options.pixel_noise = 0.4;
  options.flipped_bits = 12;
  return options;
}

struct Ride {
  std::vector<FrameEstimate> trajectory;
  std::vector<FrameReport> reports;
  std::size_t submaps = 0;
  [[nodiscard]] int count(LoopEvent event) const {
    return static_cast<int>(std::count_if(reports.begin(), reports.end(),
                                          [&](const FrameReport& r) { return r.loop == event; }));
  }
};

/// Frames of a world at `poses`; nothing where there is no pose: black images.
Ride ride(const FeatureWorld& world, const std::vector<std::optional<Rigid3>>& poses,
          Schedule schedule, const Settings& settings = {}) {
  System system(world.camera(), settings, schedule);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    StereoFrame frame = world.look(static_cast<std::int64_t>(i), poses[i].value_or(Rigid3{}));
    if (!poses[i]) {
      frame.left_features = FeatureSet{};
      frame.right_features = FeatureSet{};
    }
    system.feed(frame);
  }
  system.finish();
  map_of(system).check_consistency();
  Ride result{system.trajectory(), system.reports(), 0};
  map_of(system).keyframes().for_each(
      [&](KeyFrameId, const KeyFrame& k) { result.submaps += k.parent.valid() ? 0 : 1; });
  return result;
}

/// Largest distance between estimate and truth over the connected frames, both relative to the
/// first connected one, m.
double worst_error(const Ride& r, const std::vector<std::optional<Rigid3>>& truth) {
  std::optional<Rigid3> T_estimate_truth;
  double worst = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (!r.trajectory[i].connected) continue;
    if (!T_estimate_truth) T_estimate_truth = r.trajectory[i].T_w_c * truth[i]->inverse();
    const Rigid3 expected = *T_estimate_truth * *truth[i];
    worst = std::max(worst, (expected.t() - r.trajectory[i].T_w_c.t()).norm());
  }
  return worst;
}

class PlacesTest : public ::testing::TestWithParam<Schedule> {};

std::vector<std::optional<Rigid3>> lap_and_a_bit() {
  std::vector<std::optional<Rigid3>> poses;
  for (double s = 0; s < ring_length() + 25; s += 0.8) poses.emplace_back(ring_pose(s));
  return poses;
}

TEST_P(PlacesTest, ARoundTripClosesItsLoopOnce) {
  FeatureWorld::Options options = noisy();
  options.points = 9000;
  const FeatureWorld world = testing::ring_world(options);
  const auto poses = lap_and_a_bit();
  const Ride closed = ride(world, poses, GetParam());
  EXPECT_EQ(closed.count(LoopEvent::kClosed), 1);
  EXPECT_EQ(closed.submaps, 1u);
  Settings open_settings;
  open_settings.set("loop.enabled", "false");
  const Ride open = ride(world, poses, GetParam(), open_settings);
  EXPECT_EQ(open.count(LoopEvent::kClosed), 0);
  const auto closing =
      std::find_if(closed.reports.begin(), closed.reports.end(),
                   [](const FrameReport& r) { return r.loop != LoopEvent::kNone; });
  ASSERT_NE(closing, closed.reports.end());
  // The frame it was closed with is the one a round earlier, within what a camera sees.
  const double apart = 0.8 * static_cast<double>(closing->index - closing->loop_frame);
  EXPECT_NEAR(apart, ring_length(), 15);
  // Both ends in one place: the last frame and the one a round before it agree.
  const auto ends_apart = [&](const Ride& r) {
    const std::size_t last = poses.size() - 1;
    const auto first = static_cast<std::size_t>(20.0 / 0.8);
    const Rigid3 truth = poses[first]->inverse() * *poses[last];
    const Rigid3 estimate = r.trajectory[first].T_w_c.inverse() * r.trajectory[last].T_w_c;
    return (truth.t() - estimate.t()).norm();
  };
  EXPECT_LT(ends_apart(closed), 0.03) << "m";
  EXPECT_LT(ends_apart(closed), ends_apart(open));
  EXPECT_LT(worst_error(closed, poses), 0.25);
}

TEST_P(PlacesTest, AStraightRoadHasNoLoop) {
  FeatureWorld::Options options = noisy();
  options.length = 200;
  options.points = 16000;
  std::vector<std::optional<Rigid3>> poses;
  for (int i = 0; i < 180; ++i) poses.emplace_back(weaving_pose(0.8 * i));
  const Ride r = ride(FeatureWorld(kitti_camera(), options), poses, GetParam());
  EXPECT_EQ(r.count(LoopEvent::kClosed), 0);
  EXPECT_EQ(r.submaps, 1u);
}

FeatureWorld long_road() {
  FeatureWorld::Options options = noisy();
  options.length = 320;
  options.points = 24000;
  options.max_distance = 40;
  return {kitti_camera(), options};
}

TEST_P(PlacesTest, BlindForThreeSecondsThenAtAKnownPlaceItRelocalises) {
  std::vector<std::optional<Rigid3>> poses;
  for (int i = 0; i < 110; ++i) poses.emplace_back(weaving_pose(0.8 * i));
  for (int i = 0; i < 30; ++i) poses.emplace_back(std::nullopt);
  for (int i = 0; i < 40; ++i) poses.emplace_back(weaving_pose(14 + 0.8 * i));
  const Ride r = ride(long_road(), poses, GetParam());
  for (std::size_t i = 110; i < 140; ++i) {
    EXPECT_EQ(r.reports[i].status, FrameStatus::kLost);
    EXPECT_FALSE(r.trajectory[i].connected) << "nothing is invented for frame " << i;
  }
  EXPECT_EQ(r.reports[140].status, FrameStatus::kTracked) << r.reports[140].reason;
  EXPECT_TRUE(r.reports[140].relocalised);
  EXPECT_EQ(r.submaps, 1u);
  for (std::size_t i = 140; i < poses.size(); ++i) {
    EXPECT_TRUE(r.trajectory[i].connected) << "frame " << i << ": " << r.reports[i].reason;
  }
  EXPECT_LT(worst_error(r, poses), 0.15);
}

TEST_P(PlacesTest, AtAnUnknownPlaceANewSubmapStartsAndIsMergedOnReturn) {
  std::vector<std::optional<Rigid3>> poses;
  for (int i = 0; i < 60; ++i) poses.emplace_back(weaving_pose(0.8 * i));
  for (int i = 0; i < 30; ++i) poses.emplace_back(std::nullopt);
  // 120 m further, then backwards to where it was before.
  for (int i = 0; i < 125; ++i) poses.emplace_back(weaving_pose(120 - 0.8 * i));
  const Ride r = ride(long_road(), poses, GetParam());
  const auto started = std::find_if(r.reports.begin() + 90, r.reports.end(), [](const auto& f) {
    return f.status == FrameStatus::kStarted;
  });
  ASSERT_NE(started, r.reports.end());
  EXPECT_EQ(started - r.reports.begin(), 90) << "the first frame that shows something";
  // T_w_c of reports are in the worlds of these sub-maps.
  EXPECT_EQ(r.reports[10].submap, 0);
  EXPECT_EQ(r.reports[70].submap, -1);
  EXPECT_GT(started->submap, 0);
  EXPECT_LT(started->T_w_c.t().norm(), 1e-9);
  EXPECT_EQ(r.reports[95].submap, started->submap);
  EXPECT_EQ(r.reports.back().submap, 0) << "merged";
  EXPECT_EQ(r.count(LoopEvent::kMerged), 1);
  EXPECT_EQ(r.submaps, 1u);
  for (std::size_t i = 90; i < poses.size(); ++i) {
    EXPECT_TRUE(r.trajectory[i].connected) << "frame " << i << ": " << r.reports[i].reason;
  }
  EXPECT_TRUE(r.trajectory[10].connected);
  EXPECT_LT(worst_error(r, poses), 0.3);
}

/// T_w_c on the road at s metres, turned to the side.
Rigid3 turned(double s, double degrees) {
  const double angle = degrees * 3.14159265358979 / 180;
  return weaving_pose(s) * Rigid3(so3_exp({0, angle, 0}), Eigen::Vector3d::Zero());
}

TEST_P(PlacesTest, ASubmapThatHasJustStartedGivesWayToTheMapThatIsSeenAgain) {
  std::vector<std::optional<Rigid3>> poses;
  for (int i = 0; i < 60; ++i) poses.emplace_back(weaving_pose(0.8 * i));
  for (int i = 0; i < 30; ++i) poses.emplace_back(std::nullopt);
  // It looks to the side, where nothing is known, and turns back to the road.
  for (int i = 0; i < 9; ++i) poses.emplace_back(turned(30 + 0.2 * i, 90 - 10 * i));
  for (int i = 0; i < 40; ++i) poses.emplace_back(turned(31.8 + 0.2 * i, 0));
  const Ride r = ride(long_road(), poses, GetParam());
  EXPECT_EQ(r.reports[90].status, FrameStatus::kStarted) << r.reports[90].reason;
  const auto found = std::find_if(r.reports.begin() + 90, r.reports.end(),
                                  [](const auto& f) { return f.relocalised; });
  ASSERT_NE(found, r.reports.end());
  EXPECT_LE(found - r.reports.begin(), 99) << "while it is turning";
  for (std::size_t i = 90; i < poses.size(); ++i) {
    EXPECT_NE(r.reports[i].status, FrameStatus::kLost) << i << ": " << r.reports[i].reason;
    EXPECT_GE(r.trajectory[i].submap, 0) << i;
  }
  // The sub-map is joined where the frame that was found has a pose in both.
  EXPECT_EQ(r.count(LoopEvent::kMerged), 1);
  for (std::size_t i = 90; i < poses.size(); ++i) {
    EXPECT_TRUE(r.trajectory[i].connected) << i;
    EXPECT_EQ(r.trajectory[i].submap, 0) << i;
  }
  EXPECT_LT(worst_error(r, poses), 0.15);
}

TEST_P(PlacesTest, WhatIsNeverConnectedIsMarked) {
  std::vector<std::optional<Rigid3>> poses;
  for (int i = 0; i < 30; ++i) poses.emplace_back(weaving_pose(0.8 * i));
  for (int i = 0; i < 30; ++i) poses.emplace_back(std::nullopt);
  for (int i = 0; i < 80; ++i) poses.emplace_back(weaving_pose(150 + 0.8 * i));
  const Ride r = ride(long_road(), poses, GetParam());
  EXPECT_EQ(r.submaps, 2u);
  EXPECT_EQ(r.count(LoopEvent::kMerged), 0);
  for (std::size_t i = 0; i < 30; ++i) {
    EXPECT_FALSE(r.trajectory[i].connected) << "the other sub-map has more frames";
    EXPECT_EQ(r.trajectory[i].submap, 0);
  }
  for (std::size_t i = 70; i < poses.size(); ++i) EXPECT_TRUE(r.trajectory[i].connected);
  EXPECT_NE(r.trajectory.back().submap, 0);
  EXPECT_LT(worst_error(r, poses), 0.3);
}

INSTANTIATE_TEST_SUITE_P(Schedules, PlacesTest,
                         ::testing::Values(Schedule::kSequential, Schedule::kPipelined),
                         [](const auto& schedule) { return to_string(schedule.param); });

/// Frames come as fast as they can, which leaves a back end in real time behind by as much as the
/// machine is busy: what it finds is not fixed, but the map has to be in order.
TEST(Places, InRealTimeTheMapStaysInOrder) {
  FeatureWorld::Options options = noisy();
  options.points = 9000;
  const auto poses = lap_and_a_bit();
  const Ride r = ride(testing::ring_world(options), poses, Schedule::kRealtime);
  EXPECT_EQ(r.trajectory.size(), poses.size());
  EXPECT_GE(r.submaps, 1u);
}

TEST(Places, ThePipelineGivesTheSameTwice) {
  FeatureWorld::Options options = noisy();
  options.points = 9000;
  const FeatureWorld world = testing::ring_world(options);
  const auto poses = lap_and_a_bit();
  const Ride a = ride(world, poses, Schedule::kPipelined);
  const Ride b = ride(world, poses, Schedule::kPipelined);
  ASSERT_EQ(a.count(LoopEvent::kClosed), 1);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    ASSERT_EQ(a.trajectory[i].T_w_c.translation, b.trajectory[i].T_w_c.translation) << i;
    ASSERT_EQ(a.trajectory[i].T_w_c.rotation.coeffs(), b.trajectory[i].T_w_c.rotation.coeffs());
  }
}

}  // namespace
}  // namespace kys_slam
