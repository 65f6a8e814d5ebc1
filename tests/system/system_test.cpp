// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <filesystem>

#include "map/map.h"
#include "support/feature_world.h"
#include "system/private_access.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::weaving_pose;

struct Drive {
  std::vector<FrameEstimate> trajectory;
  std::vector<FrameReport> reports;
  std::size_t landmarks = 0;
  std::size_t keyframes = 0;
};

Drive drive(const FeatureWorld& world, Schedule schedule, int frames, double step = 0.8,
            const Settings& settings = Settings()) {
  System system(world.camera(), settings, schedule);
  for (int i = 0; i < frames; ++i) system.feed(world.look(i, weaving_pose(step * i)));
  system.finish();
  map_of(system).check_consistency();
  return {system.trajectory(), system.reports(), map_of(system).landmarks().size(),
          map_of(system).keyframes().size()};
}

/// Largest distance between estimate and truth, both relative to the first frame, m.
double worst_error(const Drive& run, double step = 0.8) {
  const Rigid3 T_0_w = weaving_pose(0).inverse();
  double worst = 0;
  for (std::size_t i = 0; i < run.trajectory.size(); ++i) {
    EXPECT_TRUE(run.trajectory[i].connected) << "frame " << i << ": " << run.reports[i].reason;
    const Rigid3 truth = T_0_w * weaving_pose(step * static_cast<double>(i));
    worst = std::max(worst, (truth.t() - run.trajectory[i].T_w_c.t()).norm());
  }
  return worst;
}

TEST(System, FollowsAnExactWorldExactly) {
  FeatureWorld::Options options;
  options.length = 140;
  options.points = 12000;
  const Drive run = drive(FeatureWorld(kitti_camera(), options), Schedule::kSequential, 100);
  EXPECT_LT(worst_error(run), 1e-3);
  EXPECT_GT(run.keyframes, 2u);
  EXPECT_LT(run.keyframes, 60u);
}

TEST(System, DriftsLittleInANoisyWorld) {
  FeatureWorld::Options options;
  options.pixel_noise = 0.5;
  options.flipped_bits = 15;
  options.length = 140;
  options.points = 12000;
  const Drive run = drive(FeatureWorld(kitti_camera(), options), Schedule::kSequential, 100);
  // Stereo odometry drifts by half a percent to one percent of the way; this easy world by less.
  EXPECT_LT(worst_error(run), 0.0025 * 0.8 * 100);
}

FeatureWorld noisy_world() {
  FeatureWorld::Options options;
  options.pixel_noise = 0.5;
  options.flipped_bits = 15;
  options.length = 140;
  options.points = 12000;
  return {kitti_camera(), options};
}

TEST(System, OfKeyframesOneInSoManyFramesIsMappedInFull) {
  const FeatureWorld world = noisy_world();
  Settings settings;
  settings.set("keyframes.every_frame", "true");
  settings.set("mapping.adjust_frames", "3");
  System system(world.camera(), settings, Schedule::kSequential);
  for (int i = 0; i < 20; ++i) system.feed(world.look(i, weaving_pose(0.8 * i)));
  system.finish();
  for (const FrameReport& report : system.reports()) {
    ASSERT_TRUE(report.keyframe) << report.index;
    // The first five in any case; then 7, 10, 13, ...
    const bool in_full = report.index < 5 || (report.index - 4) % 3 == 0;
    EXPECT_EQ(report.times.local_bundle > 0, in_full) << report.index;
  }
}

TEST(System, KeyframesOfALeanMapDependOnWhatIsSeenNotOnTheSchedule) {
  const FeatureWorld world = noisy_world();
  Settings lean;
  lean.load(std::filesystem::path(KYS_SOURCE_DIR) / "configs/lean.yaml");
  const Drive sequential = drive(world, Schedule::kSequential, 100, 0.8, lean);
  const Drive pipelined = drive(world, Schedule::kPipelined, 100, 0.8, lean);
  const auto kept = static_cast<double>(sequential.keyframes);
  EXPECT_NEAR(static_cast<double>(pipelined.keyframes), kept, 1 + 0.1 * kept);
  EXPECT_LT(kept, 45) << "of 100 frames, most of which become keyframes";
}

TEST(System, FindsAConstantDisparityErrorWithoutAJumpInTheTrajectory) {
  FeatureWorld::Options options;
  options.pixel_noise = 0.3;
  options.flipped_bits = 10;
  options.length = 200;
  options.points = 20000;
  const FeatureWorld world(kitti_camera(), options);
  Settings settings;
  settings.set("stereo.added_disparity", "0.4");
  settings.set("calibration.keyframes", "8");
  settings.set("keyframes.reference_ratio", "0.9");
  System system(world.camera(), settings, Schedule::kSequential);
  constexpr int kLength = 120;
  constexpr double kStep = 0.8;
  for (int i = 0; i < kLength; ++i) system.feed(world.look(i, weaving_pose(kStep * i)));
  system.finish();
  map_of(system).check_consistency();
  EXPECT_NEAR(map_of(system).rig().offset(), -0.4, 0.1);
  const auto estimates = system.trajectory();
  // Frame to frame: the correction has to move landmarks and last frame together.
  for (std::size_t i = 1; i < kLength; ++i) {
    const Rigid3 truth = weaving_pose(kStep * static_cast<double>(i - 1)).inverse() *
                         weaving_pose(kStep * static_cast<double>(i));
    const Rigid3 step = estimates[i - 1].T_w_c.inverse() * estimates[i].T_w_c;
    EXPECT_LT((step.t() - truth.t()).norm(), 0.05) << "frame " << i;
  }
}

/// Settings of a file of the tree that are not the default's, as KEY=VALUE.
std::vector<std::string> changes_of(const std::string& file) {
  Settings settings;
  settings.load(std::filesystem::path(KYS_SOURCE_DIR) / "configs" / file);
  settings.check();
  std::vector<std::string> changes;
  const auto defaults = Settings().describe();
  const auto values = settings.describe();
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (values[i].value != defaults[i].value) {
      changes.push_back(values[i].key + "=" + values[i].value);
    }
  }
  return changes;
}

TEST(Configurations, FilesOfTheTreeChangeWhatTheySay) {
  using Changes = std::vector<std::string>;
  EXPECT_EQ(changes_of("kys_default.yaml"), Changes{});
  EXPECT_EQ(
      changes_of("kys_paper.yaml"),
      (Changes{"tracking.min_motion_matches=20", "tracking.align=false",
               "tracking.landmark_noise=0", "tracking.acceleration=0", "tracking.image_area=false",
               "keyframes.reference_ratio=0.75", "keyframes.untracked_ratio=0",
               "keyframes.min_tracked=0", "mapping.bundle_keyframes=20", "place.min_area=0",
               "control.pipeline_delay=3", "kys.normalize=false"}));
  EXPECT_EQ(changes_of("accurate.yaml"),
            (Changes{"keyframes.every_frame=true", "mapping.bundle_keyframes=10",
                     "calibration.keyframes=40"}));
  EXPECT_EQ(changes_of("lean.yaml"),
            (Changes{"keyframes.max_frames=0", "mapping.bundle_fixed=10",
                     "mapping.sparse_overlap=0.35", "mapping.adjust_frames=2"}));
  EXPECT_EQ(
      changes_of("baseline.yaml"),
      (Changes{"orb.subpixel=false", "tracking.min_motion_matches=20", "tracking.align=false",
               "tracking.landmark_noise=0", "tracking.acceleration=0", "tracking.image_area=false",
               "keyframes.max_frames=10", "keyframes.reference_ratio=0.75",
               "keyframes.untracked_ratio=0", "keyframes.min_tracked=0",
               "mapping.bundle_keyframes=20", "calibration.enabled=false", "place.min_area=0",
               "control.pipeline_delay=3", "control.blend_poses=false"}));
}

TEST(System, FramesFollowTheKeyframeBeforeThemAloneWhenPosesAreNotBlended) {
  FeatureWorld::Options options;
  options.pixel_noise = 0.5;
  options.flipped_bits = 15;
  options.length = 140;
  options.points = 12000;
  const FeatureWorld world(kitti_camera(), options);
  std::vector<std::vector<FrameEstimate>> runs;
  for (const char* blend : {"true", "false"}) {
    Settings settings;
    settings.set("control.blend_poses", blend);
    settings.set("keyframes.min_frames", "6");
    System system(world.camera(), settings, Schedule::kSequential);
    for (int i = 0; i < 60; ++i) system.feed(world.look(i, weaving_pose(0.3 * i)));
    system.finish();
    runs.push_back(system.trajectory());
  }
  int moved = 0;
  for (std::size_t i = 0; i < runs[0].size(); ++i) {
    const double apart = (runs[0][i].T_w_c.t() - runs[1][i].T_w_c.t()).norm();
    EXPECT_LT(apart, 0.1) << "frame " << i;
    moved += apart > 1e-9 ? 1 : 0;
  }
  EXPECT_GT(moved, 10);
}

}  // namespace
}  // namespace kys_slam
