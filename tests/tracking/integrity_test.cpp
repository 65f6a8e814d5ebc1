// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "support/map_builder.h"
#include "tracking/tracker.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::see;
using testing::weaving_pose;

/// Features that are put together from several sources, with their columns in the right image.
struct SyntheticFrame {
  FeatureSet left;
  std::vector<float> u_right;

  void add(const FrameFeatures& from, std::size_t i, float disparity) {
    left.keypoints.push_back(from.keypoint(i));
    left.descriptors.push_back(from.descriptor(i));
    u_right.push_back(from.keypoint(i).x - disparity);
  }
  [[nodiscard]] std::shared_ptr<const FrameFeatures> take() {
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(left),
                                                 std::move(u_right), std::vector<kys::Prior>{});
  }
};

class IntegrityOfFrames : public ::testing::Test {
 protected:
  static FeatureWorld world() {
    FeatureWorld::Options options;
    options.seed = 3;
    return {testing::kitti_camera(), options};
  }
  static float disparity(const FrameFeatures& features, std::size_t i) {
    return features.keypoint(i).x - features.u_right(i);
  }
  /// What a camera sees whose own vehicle covers the rows from `top` on, `nearness` px of disparity
  /// away; one of `every` corners of it is found.
  std::shared_ptr<const FrameFeatures> over_bonnet(int index, double metres, float top,
                                                   std::size_t every) {
    const auto seen = see(world_, index, weaving_pose(metres));
    const auto bonnet = testing::random_features(testing::kitti_camera(), 2000, 5, 1.0);
    SyntheticFrame frame;
    for (std::size_t i = 0; i < seen.features->size(); ++i) {
      if (seen.features->keypoint(i).y >= top || !seen.features->has_stereo(i)) continue;
      frame.add(*seen.features, i, disparity(*seen.features, i));
    }
    for (std::size_t i = 0; i < bonnet->size(); i += every) {
      if (bonnet->keypoint(i).y >= top) frame.add(*bonnet, i, 60);
    }
    return frame.take();
  }
  /// A camera whose own vehicle covers the rows from `bottom` on and that sees corners without a
  /// disparity above, as those of trees, `metres` on its way.
  std::shared_ptr<const FrameFeatures> under_trees(int index, double metres, float bottom) {
    const auto seen = see(world_, index, weaving_pose(metres));
    const auto bonnet = testing::random_features(testing::kitti_camera(), 2000, 5, 1.0);
    SyntheticFrame frame;
    for (std::size_t i = 0; i < seen.features->size(); ++i) {
      if (seen.features->keypoint(i).y < bottom) {
        frame.add(*seen.features, i, testing::kNoStereo);
      }
    }
    for (std::size_t i = 0; i < bonnet->size(); ++i) {
      if (bonnet->keypoint(i).y >= bottom) frame.add(*bonnet, i, 60);
    }
    return frame.take();
  }
  /// A standing camera in front of a scene of 2 to 40 px of disparity. In the middle columns
  /// something of another disparity (px) goes by, 12 px per frame.
  static std::shared_ptr<const FrameFeatures> with_passing(int index, float disparity_there) {
    constexpr float kLeft = 490, kRight = 860;
    const auto scene = testing::random_features(testing::kitti_camera(), 1500, 5, 1.0);
    const auto passing = testing::random_features(testing::kitti_camera(), 1500, 6, 1.0);
    SyntheticFrame frame;
    for (std::size_t i = 0; i < scene->size(); ++i) {
      const float x = scene->keypoint(i).x;
      if (x < kLeft || x > kRight) frame.add(*scene, i, disparity(*scene, i));
    }
    for (std::size_t i = 0; i < passing->size(); ++i) {
      const float x = passing->keypoint(i).x + 12 * static_cast<float>(index);
      if (x < kLeft || x > kRight) continue;
      frame.add(*passing, i, 0);
      frame.left.keypoints.back().x = x;
      frame.u_right.back() = x - disparity_there;
    }
    return frame.take();
  }
  TrackResult track(int index, std::shared_ptr<const FrameFeatures> features) {
    return tracker_.track({index, 0.1 * index, std::move(features)}, 0);
  }
  static Rigid3 truth(double metres) { return weaving_pose(0).inverse() * weaving_pose(metres); }
  static double error(const TrackResult& result, double metres) {
    return (result.T_c_w.inverse().t() - truth(metres).t()).norm();
  }

  FeatureWorld world_ = world();
  kys::DistanceModel model_;
  Tracker tracker_{testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model_};
};

TEST_F(IntegrityOfFrames, AStaticSceneThatIsFollowedIsSound) {
  for (int i = 0; i < 12; ++i) {
    const TrackResult result = track(i, see(world_, i, weaving_pose(0.4 * i)).features);
    ASSERT_NE(result.status, TrackingStatus::kLost);
    EXPECT_EQ(result.integrity.integrity, Integrity::kOk) << to_string(result.integrity.reason);
    EXPECT_FALSE(result.integrity.keeps_place);
  }
}

TEST_F(IntegrityOfFrames, AVehicleThatHoldsThePoseIsContradictedByTheSceneBehindIt) {
  for (int i = 0; i < 12; ++i) {
    const TrackResult result = track(i, over_bonnet(i, 0.8 * i, 170, 1));
    ASSERT_NE(result.status, TrackingStatus::kLost) << result.reason;
    if (i < 4) continue;  // the scene is still followed in part
    ASSERT_GT(error(result, 0.8 * i), 1.0) << "the test needs a pose that stands";
    EXPECT_EQ(result.integrity.integrity, Integrity::kContradicted) << i;
    EXPECT_EQ(result.integrity.reason, IntegrityReason::kTwoMotions) << i;
  }
}

TEST_F(IntegrityOfFrames, AVehicleThatLeavesThePoseAloneIsToldAndContradictsNothing) {
  const int told_after = IntegrityOptions().still_frames;
  for (int i = 0; i < told_after + 4; ++i) {
    const TrackResult result = track(i, over_bonnet(i, 0.8 * i, 250, 8));
    ASSERT_LT(error(result, 0.8 * i), 0.05) << i << result.reason;
    EXPECT_NE(result.integrity.reason, IntegrityReason::kTwoMotions) << i;
    // The first frame with a motion to compare is the second.
    EXPECT_EQ(result.integrity.keeps_place, i >= told_after) << i;
  }
}

TEST_F(IntegrityOfFrames, ASceneWithoutDisparitiesThatPassesAVehicleContradictsItOverTime) {
  const IntegrityOptions options;
  for (int i = 0; i < options.passing_window + 4; ++i) {
    const TrackResult result = track(i, under_trees(i, 0.4 * i, 170));
    ASSERT_NE(result.status, TrackingStatus::kLost) << result.reason;
    if (i == 0) continue;
    ASSERT_GT(error(result, 0.4 * i), 0.3) << "the test needs a pose that stands";
    // The first frame with a motion to compare is the second.
    if (i < options.passing) {
      EXPECT_EQ(result.integrity.integrity, Integrity::kOk) << i;
    } else if (i >= options.passing_window) {
      EXPECT_EQ(result.integrity.integrity, Integrity::kContradicted) << i;
      EXPECT_EQ(result.integrity.reason, IntegrityReason::kTwoMotions) << i;
    }
  }
}

TEST_F(IntegrityOfFrames, TreesThatKeepTheirPlaceContradictNothing) {
  for (int i = 0; i < 12; ++i) {
    const TrackResult result = track(i, under_trees(i, 0, 170));
    ASSERT_NE(result.status, TrackingStatus::kLost) << result.reason;
    EXPECT_EQ(result.integrity.integrity, Integrity::kOk) << i;
  }
}

TEST_F(IntegrityOfFrames, WhatPassesAStandingCameraInFrontOfTheSceneContradictsNothing) {
  for (int i = 0; i < 12; ++i) {
    const TrackResult result = track(i, with_passing(i, 30));
    ASSERT_NE(result.status, TrackingStatus::kLost) << result.reason;
    ASSERT_LT(result.T_c_w.t().norm(), 0.01)
        << i << ", " << result.reason << ": the test needs a pose that stands";
    EXPECT_EQ(result.integrity.integrity, Integrity::kOk)
        << i << to_string(result.integrity.reason);
  }
}

TEST_F(IntegrityOfFrames, WhatPassesAStandingCameraBehindTheSceneContradictsIt) {
  for (int i = 0; i < 12; ++i) {
    const TrackResult result = track(i, with_passing(i, 1));
    ASSERT_LT(result.T_c_w.t().norm(), 0.01)
        << i << ", " << result.reason << ": the test needs a pose that stands";
    if (i < IntegrityOptions().passing) continue;
    EXPECT_EQ(result.integrity.reason, IntegrityReason::kTwoMotions) << i;
  }
}

/// At 2 km, where f b = 379 px m gives disparities of 0.2 px, a camera may be anywhere within
/// metres. Pixels differ by 0.1 px from frame to frame.
TEST_F(IntegrityOfFrames, APoseFromPointsWithoutParallaxIsUncertain) {
  const auto far = testing::random_features(testing::kitti_camera(), 400, 9, 1.0);
  int doubted = 0;
  for (int i = 0; i < 8; ++i) {
    SyntheticFrame frame;
    for (std::size_t k = 0; k < far->size(); ++k) {
      frame.add(*far, k, 0.2f + 0.05f * std::sin(static_cast<float>(k + 7 * k * i)));
      frame.left.keypoints.back().x += 0.1f * std::sin(static_cast<float>(3 * k + 11 * i));
      frame.left.keypoints.back().y += 0.1f * std::cos(static_cast<float>(5 * k + 13 * i));
    }
    const TrackResult result = track(i, frame.take());
    if (result.status != TrackingStatus::kTracked) continue;
    const IntegrityReason reason = result.integrity.reason;
    EXPECT_TRUE(reason == IntegrityReason::kWeakGeometry || reason == IntegrityReason::kHeld)
        << i << to_string(reason);
    ++doubted;
  }
  EXPECT_GE(doubted, 6) << "frames with a pose";
}

TEST_F(IntegrityOfFrames, CanBeSwitchedOff) {
  TrackerOptions options;
  options.integrity.enabled = false;
  Tracker tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), options, model_);
  for (int i = 0; i < 6; ++i) {
    const TrackResult result = tracker.track({i, 0.1 * i, over_bonnet(i, 0.8 * i, 170, 1)}, 0);
    EXPECT_EQ(result.integrity.integrity, Integrity::kOk);
  }
}

}  // namespace
}  // namespace kys_slam
