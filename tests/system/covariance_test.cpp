// SPDX-License-Identifier: BSD-3-Clause
// Covariances that a system reports: which frames have one, and that they fit the errors of poses
// in a simulated world.
#include <gtest/gtest.h>
#include <kys_slam/system.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "support/feature_world.h"
#include "support/rendered_corridor.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::weaving_pose;

constexpr int kDriven = 60;

FeatureWorld driven_world() {
  FeatureWorld::Options options;
  options.pixel_noise = 0.3;
  options.length = 80;
  options.points = 6000;
  return {kitti_camera(), options};
}

/// T_w_c of a frame.
Rigid3 pose_at(std::int64_t frame) {
  return weaving_pose(0.8 * static_cast<double>(frame));
}

Rigid3 true_motion(std::int64_t from, std::int64_t to) {
  return pose_at(from).inverse() * pose_at(to);
}

void expect_positive_definite(const RelativePose::Covariance& C) {
  EXPECT_EQ(C, RelativePose::Covariance(C.transpose()));
  EXPECT_EQ(Eigen::LLT<RelativePose::Covariance>(C).info(), Eigen::Success);
}

/// e^T C^-1 e / 6 of a relative pose.
double nees(const RelativePose& pose, const Rigid3& truth) {
  const Rigid3 away = pose.T_other_c.inverse() * truth;
  Eigen::Matrix<double, 6, 1> e;
  e << so3_log(away.rotation), away.translation;
  return e.dot(pose.covariance.llt().solve(e)) / 6;
}

TEST(Covariance, EveryTrackedFrameHasThemAndTheyFitItsErrors) {
  const FeatureWorld w = driven_world();
  System system(w.camera(), Settings(), Schedule::kSequential);
  double motion = 0, local = 0;
  for (int k = 0; k < kDriven; ++k) {
    const FrameReport report = system.feed(w.look(k, pose_at(k)));
    if (k == 0) {
      EXPECT_EQ(report.status, FrameStatus::kStarted);
      EXPECT_FALSE(report.local || report.motion);
      continue;
    }
    ASSERT_EQ(report.status, FrameStatus::kTracked) << report.reason;
    ASSERT_TRUE(report.local && report.motion);
    expect_positive_definite(report.local->covariance);
    expect_positive_definite(report.motion->covariance);
    EXPECT_EQ(report.motion->other, k - 1);
    EXPECT_LT(report.local->other, k);
    motion += nees(*report.motion, true_motion(k - 1, k));
    local += nees(*report.local, true_motion(report.local->other, k));
  }
  // Of 59 frames; the noise of the simulated features is independent, which the calibration of the
  // covariances on images does not assume.
  EXPECT_GT(motion / (kDriven - 1), 0.3);
  EXPECT_LT(motion / (kDriven - 1), 2);
  EXPECT_GT(local / (kDriven - 1), 0.3);
  EXPECT_LT(local / (kDriven - 1), 2);
  system.finish();
  const std::vector<FrameEstimate> path = system.trajectory();
  const std::vector<FrameReport> reports = system.reports();
  for (std::size_t k = 1; k < path.size(); ++k) {
    ASSERT_TRUE(path[k].local && path[k].motion);
    EXPECT_EQ(path[k].local->covariance, reports[k].local->covariance);
  }
}

TEST(Covariance, LostFramesHaveNone) {
  const FeatureWorld w = driven_world();
  Settings settings;
  settings.assign("relocalization.patience=1000");
  System system(w.camera(), settings, Schedule::kSequential);
  for (int k = 0; k < 20; ++k) {
    StereoFrame frame = w.look(k, pose_at(k));
    const bool blind = k >= 10 && k < 13;
    if (blind) {
      frame.left_features = FeatureSet();
      frame.right_features = FeatureSet();
    }
    const FrameReport report = system.feed(frame);
    if (blind) {
      EXPECT_EQ(report.status, FrameStatus::kLost);
      EXPECT_FALSE(report.local || report.motion);
    } else if (report.status == FrameStatus::kTracked) {
      EXPECT_TRUE(report.local);
      EXPECT_EQ(report.motion.has_value(), !report.relocalised);
      if (k == 13 && report.motion) {
        EXPECT_EQ(report.motion->other, 9);
      }
    }
  }
}

}  // namespace
}  // namespace kys_slam
