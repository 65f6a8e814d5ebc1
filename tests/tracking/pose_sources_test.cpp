// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/pose_sources.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"
#include "tracking/tracker.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::weaving_pose;

/// A camera that went 0.4 m per frame for three frames; sources look for it in a fourth.
class PoseSources : public ::testing::Test {
 protected:
  static FeatureWorld world(unsigned seed) {
    FeatureWorld::Options options;
    options.seed = seed;
    return {testing::kitti_camera(), options};
  }
  PoseSources() {
    for (int i = 0; i < 3; ++i) {
      last_.features = testing::see(world_, i, weaving_pose(0.4 * i)).features;
      last_.index = i;
      last_.taken = motion_.time_of(i, 0.1 * i, false);
      const TrackResult result = tracker_.track({i, 0.1 * i, last_.features}, 0);
      reference_ = result.pose.reference;
      last_.T_c_w = result.T_c_w;
      motion_.add(i, last_.taken, result.T_c_w, MotionModel::Link::kTracked);
    }
    const auto landmarks = tracker_.last_landmarks();
    last_.landmarks.assign(landmarks.begin(), landmarks.end());
  }
  TrackingContext context() {
    return {camera_, scales_,  options_,  model_, tracker_.replica(),
            motion_, beliefs_, gatherer_, &last_, reference_};
  }
  TrackedFrame frame(const FeatureWorld& seen_world, double metres) {
    TrackedFrame frame;
    frame.index = 3;
    frame.timestamp = 0.3;
    frame.taken = motion_.time_of(3, 0.3, false);
    frame.features = testing::see(seen_world, 3, weaving_pose(metres)).features;
    frame.landmarks.resize(frame.features->size());
    return frame;
  }
  static double error(const Attempt& attempt, double metres) {
    const Rigid3 truth = weaving_pose(0).inverse() * weaving_pose(metres);
    return (attempt.candidate.T_c_w.inverse().t() - truth.t()).norm();
  }
  static void expect_candidate(const Attempt& attempt, PoseSource source, double metres) {
    ASSERT_TRUE(attempt.found()) << attempt.failure;
    EXPECT_EQ(attempt.candidate.source, source);
    EXPECT_LT(error(attempt, metres), 5e-3) << to_string(source);
    const Evidence& evidence = attempt.candidate.evidence;
    EXPECT_GE(evidence.matches, evidence.inliers);
    EXPECT_EQ(evidence.inliers,
              std::ranges::count_if(attempt.candidate.landmarks, &LandmarkId::valid));
    EXPECT_GT(attempt.statistics.total(), 0u);
  }

  StereoCamera camera_ = testing::kitti_camera();
  ScaleLevels scales_{1.2, 8};
  TrackerOptions options_;
  kys::DistanceModel model_;
  kys::InitialBelief start_;
  FeatureWorld world_ = world(1);
  Tracker tracker_{camera_, scales_, options_, model_};
  MotionModel motion_{options_.motion};
  Beliefs beliefs_{nullptr, start_, model_, 3};
  LocalMapGatherer gatherer_;
  TrackedFrame last_;
  KeyFrameId reference_;
};

TEST_F(PoseSources, FindTheCameraThatGoesOn) {
  const TrackedFrame now = frame(world_, 1.2);
  expect_candidate(MotionSource{}.find(context(), now), PoseSource::kMotion, 1.2);
  expect_candidate(ReferenceSource{}.find(context(), now), PoseSource::kReference, 1.2);
  expect_candidate(MapSource{}.find(context(), now), PoseSource::kMap, 1.2);
}

TEST_F(PoseSources, WithoutAnExpectationFindACameraThatIsElsewhere) {
  const TrackedFrame now = frame(world_, 0.1);
  expect_candidate(ReferenceSource{}.find(context(), now), PoseSource::kReference, 0.1);
  expect_candidate(MapSource{}.find(context(), now), PoseSource::kMap, 0.1);
}

TEST_F(PoseSources, StereoPointsSufficeWhereThereAreNoLandmarks) {
  std::fill(last_.landmarks.begin(), last_.landmarks.end(), LandmarkId{});
  const TrackedFrame now = frame(world_, 1.2);
  EXPECT_EQ(MotionSource{}.find(context(), now).failure, "0 matches");
  const Attempt points = PointSource{}.find(context(), now);
  ASSERT_TRUE(points.found()) << points.failure;
  EXPECT_LT(error(points, 1.2), 0.02);
  EXPECT_EQ(std::ranges::count_if(points.candidate.landmarks, &LandmarkId::valid), 0);
}

TEST_F(PoseSources, SayHowFarTheyCameInAnotherPlace) {
  const TrackedFrame elsewhere = frame(world(77), 0);
  const Attempt attempts[] = {
      MotionSource{}.find(context(), elsewhere), ReferenceSource{}.find(context(), elsewhere),
      MapSource{}.find(context(), elsewhere), PointSource{}.find(context(), elsewhere)};
  for (const Attempt& attempt : attempts) {
    EXPECT_FALSE(attempt.found());
    EXPECT_TRUE(attempt.failure.ends_with(" matches") || attempt.failure.ends_with(" inliers"))
        << attempt.failure;
  }
}

TEST_F(PoseSources, APartOfTheKeyframeGivesPartOfTheMatches) {
  const TrackedFrame now = frame(world_, 1.2);
  const Attempt all = ReferenceSource{}.find(context(), now);
  const Attempt part = ReferenceSource{4}.find(context(), now);
  ASSERT_TRUE(part.found()) << part.failure;
  EXPECT_NEAR(4.0 * part.candidate.evidence.matches, all.candidate.evidence.matches,
              0.3 * all.candidate.evidence.matches);
}

}  // namespace
}  // namespace kys_slam
