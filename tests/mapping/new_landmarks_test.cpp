// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "mapping/fusion.h"
#include "mapping/local_mapper.h"
#include "mapping/triangulation.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kf;
using testing::lm;
using testing::make_keyframe;
using testing::make_landmark;
using testing::random_features;

class InsertKeyFrame : public ::testing::Test {
 protected:
  InsertKeyFrame() {
    for (std::uint32_t k = 0; k < 2; ++k) {
      map_.add_keyframe(make_keyframe(k, random_features(map_.camera(), 50, k, 1.0)));
    }
    for (std::uint32_t i = 0; i < 20; ++i) {
      map_.add_landmark(make_landmark(2 * i, {1.0 * i, 1, 15}));
      map_.add_observation(lm(2 * i), kf(0), i);
      map_.add_observation(lm(2 * i), kf(1), i);
      map_.refresh_landmark(lm(2 * i));
    }
    map_.connect_to_spanning_tree(kf(1), kf(0));
    message_.id = kf(2);
    message_.frame_index = 17;
    message_.timestamp = 1.7;
    message_.features = random_features(map_.camera(), 50, 2, 1.0);
    message_.tracked.resize(50);
    message_.reference = kf(1);
    message_.T_c_reference = Rigid3(so3_exp({0, 0.1, 0}), {0, 0, -1});
    message_.T_c_w = message_.T_c_reference * map_.keyframe(kf(1)).T_c_w;
  }

  Map map_{testing::kitti_camera(), ScaleLevels(1.2, 8)};
  KeyFrameMessage message_;
};

TEST_F(InsertKeyFrame, BringsWhatItSawAndWhatItMade) {
  for (std::uint32_t i = 0; i < 16; ++i) message_.tracked[i] = lm(2 * i);
  message_.new_landmarks = {{lm(100), 30, {1, 2, 12}}, {lm(102), 31, {2, 2, 12}}};
  message_.counts = {{lm(0), 4, 3}, {lm(2), 5, 0}};
  insert_keyframe(map_, message_);
  map_.check_consistency();
  const KeyFrame& keyframe = map_.keyframe(kf(2));
  EXPECT_EQ(keyframe.frame_index, 17);
  EXPECT_EQ(keyframe.timestamp, 1.7);
  EXPECT_EQ(keyframe.parent, kf(1)) << "shares 16 with both: the younger";
  EXPECT_EQ(keyframe.landmarks[3], lm(6));
  EXPECT_EQ(keyframe.landmarks[30], lm(100));
  EXPECT_EQ(map_.landmark(lm(100)).first_keyframe, kf(2));
  EXPECT_LT((map_.landmark(lm(100)).p_w - Eigen::Vector3d(1, 2, 12)).norm(), 1e-9);
  EXPECT_EQ(map_.landmark(lm(0)).visible, 5u);
  EXPECT_EQ(map_.landmark(lm(0)).found, 4u);
  EXPECT_EQ(map_.landmark(lm(2)).found, 1u);
}

TEST_F(InsertKeyFrame, MovesWithItsReferenceWhichMayHaveMovedMeanwhile) {
  message_.new_landmarks = {{lm(100), 30, {1, 2, 12}}};
  const Eigen::Vector3d p_c = message_.T_c_w * Eigen::Vector3d(1, 2, 12);
  map_.set_pose(kf(1), Rigid3(so3_exp({0.2, 0, 0.1}), {3, -1, 2}));
  insert_keyframe(map_, message_);
  const Rigid3 expected = message_.T_c_reference * map_.keyframe(kf(1)).T_c_w;
  EXPECT_LT(minus(map_.keyframe(kf(2)).T_c_w, expected).norm(), 1e-12);
  EXPECT_LT((map_.keyframe(kf(2)).T_c_w * map_.landmark(lm(100)).p_w - p_c).norm(), 1e-9)
      << "a new landmark stays where its keyframe saw it";
}

TEST_F(InsertKeyFrame, NewLandmarksHaveTheDepthOfThePresentDisparityOffset) {
  const auto& features = *message_.features;
  std::uint32_t stereo = 0;
  while (!features.has_stereo(stereo)) ++stereo;
  const Keypoint& k = features.keypoint(stereo);
  const Eigen::Vector3d p_c = map_.camera().back_project(k.x, k.y, features.depth(stereo));
  message_.new_landmarks = {{lm(100), stereo, message_.T_c_w.inverse() * p_c}};
  map_.set_rig(RigCorrection::of_offset(map_.camera(), 0.5));
  insert_keyframe(map_, message_);
  const KeyFrame& keyframe = map_.keyframe(kf(2));
  const Eigen::Vector3d expected =
      map_.camera().back_project(k.x, k.y, keyframe.features->depth(stereo));
  EXPECT_GT((expected - p_c).norm(), 0.1) << "m";
  EXPECT_LT((keyframe.T_c_w * map_.landmark(lm(100)).p_w - expected).norm(), 1e-4);
}

TEST_F(InsertKeyFrame, FindsLandmarksThatWereMergedAndPassesOverThoseThatWent) {
  message_.tracked[5] = lm(0);
  message_.tracked[6] = lm(4);
  message_.counts = {{lm(0), 2, 2}, {lm(4), 2, 2}, {lm(888), 1, 1}};
  map_.replace_landmark(lm(0), lm(2));
  map_.erase_landmark(lm(4));
  insert_keyframe(map_, message_);
  map_.check_consistency();
  EXPECT_EQ(map_.keyframe(kf(2)).landmarks[5], lm(2));
  EXPECT_FALSE(map_.keyframe(kf(2)).landmarks[6].valid());
}

TEST_F(InsertKeyFrame, TwoTrackedLandmarksThatWereMergedGiveOneObservation) {
  message_.tracked[5] = lm(0);
  message_.tracked[6] = lm(2);
  map_.replace_landmark(lm(0), lm(2));
  insert_keyframe(map_, message_);
  map_.check_consistency();
  EXPECT_EQ(map_.keyframe(kf(2)).landmarks[5], lm(2));
  EXPECT_FALSE(map_.keyframe(kf(2)).landmarks[6].valid());
}

TEST_F(InsertKeyFrame, ANewLandmarkGivesWayToOneSeenAgain) {
  message_.tracked[5] = lm(0);
  message_.new_landmarks = {{lm(100), 5, {1, 2, 12}}};
  insert_keyframe(map_, message_);
  map_.check_consistency();
  EXPECT_FALSE(map_.has(lm(100)));
  EXPECT_EQ(map_.keyframe(kf(2)).landmarks[5], lm(0));
}

TEST_F(InsertKeyFrame, AReferenceThatWasCulledIsFollowedToItsParent) {
  const Rigid3 before = *map_.pose(kf(1));
  ASSERT_TRUE(map_.cull_keyframe(kf(1)));
  insert_keyframe(map_, message_);
  map_.check_consistency();
  EXPECT_EQ(map_.keyframe(kf(2)).parent, kf(0));
  EXPECT_LT(minus(map_.keyframe(kf(2)).T_c_w, message_.T_c_reference * before).norm(), 1e-9);
}

class Triangulation : public ::testing::Test {
 protected:
  struct Result {
    int made = 0;
    int mixed = 0;              // observations of features of different points
    std::vector<double> error;  // relative to the distance, sorted
  };
  Result run(double noise, bool stereo) {
    FeatureWorld::Options options;
    options.points = 2500;
    options.pixel_noise = noise;
    const FeatureWorld world(testing::kitti_camera(), options);
    // Every third point is known and ties the keyframes together.
    const std::vector<Rigid3> poses{Rigid3(), Rigid3(so3_exp({0, 0.02, 0}), {0.9, 0, 0.4}),
                                    Rigid3(so3_exp({0, -0.01, 0}), {-0.6, 0.1, 0.8})};
    testing::WorldMap built =
        testing::map_of_world(world, poses, 0, stereo, [](std::size_t p) { return p % 3 == 0; });
    LandmarkIdAllocator ids(LandmarkIdAllocator::Maker::kBackEnd);
    ids.continue_after(5000);
    kys::Statistics statistics;
    const std::vector<LandmarkId> made =
        triangulate_landmarks(built.map, kf(2), ids, {}, kys::DistanceModel(), statistics);
    built.map.check_consistency();
    EXPECT_EQ(ids.next().value, 5001 + 2 * made.size());
    Result result;
    result.made = static_cast<int>(made.size());
    for (const LandmarkId id : made) {
      EXPECT_EQ(id.value % 2, 1u) << "even ids are the tracker's";
      const Landmark& landmark = built.map.landmark(id);
      EXPECT_EQ(landmark.observations.size(), 2u);
      EXPECT_EQ(landmark.first_keyframe, kf(2));
      std::set<std::size_t> points;
      for (const Observation& o : landmark.observations) {
        points.insert(built.seen[o.keyframe.value].points[o.feature]);
      }
      if (points.size() != 1) {
        ++result.mixed;
        continue;
      }
      const Eigen::Vector3d& truth = world.points()[*points.begin()].p_w;
      result.error.push_back((landmark.p_w - truth).norm() / (truth - poses[2].t()).norm());
    }
    std::sort(result.error.begin(), result.error.end());
    return result;
  }
};

TEST_F(Triangulation, ExactViewsGiveExactPoints) {
  for (const bool stereo : {false, true}) {
    const Result result = run(0, stereo);
    EXPECT_GT(result.made, 100);
    EXPECT_EQ(result.mixed, 0);
    EXPECT_LT(result.error.back(), 1e-3);
  }
}

TEST_F(Triangulation, NoisyViewsGivePointsNearby) {
  for (const bool stereo : {false, true}) {
    const Result result = run(0.5, stereo);
    EXPECT_GT(result.made, 80);
    EXPECT_EQ(result.mixed, 0);
    EXPECT_LT(result.error[result.error.size() / 2], 0.04);
  }
}

TEST(TriangulationRules, NothingIsMadeWithoutABaseline) {
  const FeatureWorld world(testing::kitti_camera(), {});
  const std::vector<Rigid3> poses{Rigid3(), Rigid3(Eigen::Quaterniond::Identity(), {0.3, 0, 0})};
  Map map =
      testing::map_of_world(world, poses, 0, true, [](std::size_t p) { return p % 3 == 0; }).map;
  LandmarkIdAllocator ids(LandmarkIdAllocator::Maker::kBackEnd);
  kys::Statistics statistics;
  EXPECT_TRUE(triangulate_landmarks(map, kf(1), ids, {}, kys::DistanceModel(), statistics).empty());
}

TEST(Fusion, LandmarksMadeTwiceBecomeOneAndNoOthers) {
  FeatureWorld::Options options;
  options.points = 1500;
  options.pixel_noise = 0.3;
  options.flipped_bits = 10;
  const FeatureWorld world(testing::kitti_camera(), options);
  testing::WorldMap built = testing::map_of_world(world, testing::weaving_poses(6, 0.7));
  Map& map = built.map;
  const std::size_t before = map.landmarks().size();
  // Every second landmark is torn in two: keyframes 3 to 5 see a copy of their own.
  std::map<LandmarkId, std::size_t> point_of;
  std::uint32_t next = 10001;
  for (const LandmarkId id : map.landmarks().ids()) {
    point_of[id] = id.value;
    if (id.value % 2 != 0) continue;
    const std::vector<Observation> observations = map.landmark(id).observations;
    if (observations.size() < 6) continue;
    const LandmarkId copy{next};
    next += 2;
    map.add_landmark(make_landmark(copy.value, map.landmark(id).p_w, kf(3)));
    for (const Observation& o : observations) {
      if (o.keyframe < kf(3)) continue;
      map.remove_observation(id, o.keyframe);
      map.add_observation(copy, o.keyframe, o.feature);
    }
    map.refresh_landmark(copy);
    map.refresh_landmark(id);
    point_of[copy] = id.value;
  }
  map.check_consistency();
  const std::size_t copies = map.landmarks().size() - before;
  ASSERT_GT(copies, 60u);
  kys::Statistics statistics;
  const int fused = fuse_landmarks(map, kf(5), {}, kys::DistanceModel(), statistics);
  map.check_consistency();
  const std::size_t left = map.landmarks().size() - before;
  EXPECT_LT(left, copies / 10) << "of " << copies << " copies";
  EXPECT_GE(fused, static_cast<int>(copies - left));
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    for (const Observation& o : landmark.observations) {
      EXPECT_EQ(built.seen[o.keyframe.value].points[o.feature], point_of.at(id));
    }
  });
}

TEST(Fusion, FeaturesWithoutALandmarkAreGivenOne) {
  FeatureWorld::Options options;
  options.points = 1500;
  const FeatureWorld world(testing::kitti_camera(), options);
  testing::WorldMap built = testing::map_of_world(world, testing::weaving_poses(5, 0.7));
  Map& map = built.map;
  int taken = 0;
  for (const LandmarkId id : map.landmarks().ids()) {
    if (map.landmark(id).observations.size() < 5 || id.value % 2 != 0) continue;
    map.remove_observation(id, kf(4));
    ++taken;
  }
  for (const LandmarkId id : map.landmarks().ids()) map.refresh_landmark(id);
  ASSERT_GT(taken, 50);
  kys::Statistics statistics;
  const int fused = fuse_landmarks(map, kf(4), {}, kys::DistanceModel(), statistics);
  map.check_consistency();
  EXPECT_GT(fused, 9 * taken / 10);
}

}  // namespace
}  // namespace kys_slam
