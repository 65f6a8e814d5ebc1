#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include "map/map.h"
#include "support/feature_world.h"

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

Drive drive(const FeatureWorld& world, Schedule schedule, int frames, double step = 0.8) {
  System system(world.camera(), Settings(), schedule);
  for (int i = 0; i < frames; ++i) system.feed(world.look(i, weaving_pose(step * i)));
  system.finish();
  system.map().check_consistency();
  return {system.trajectory(), system.reports(), system.map().landmarks().size(),
          system.map().keyframes().size()};
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

}  // namespace
}  // namespace kys_slam
