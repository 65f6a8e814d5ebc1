// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

#include <gtest/gtest.h>
#include <kys/kys.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <cmath>
#include <set>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::see;
using testing::weaving_pose;

class TrackerTest : public ::testing::Test {
 protected:
  static FeatureWorld world(unsigned seed) {
    FeatureWorld::Options options;
    options.seed = seed;
    return {testing::kitti_camera(), options};
  }
  TrackResult track(std::int64_t index, std::shared_ptr<const FrameFeatures> features,
                    int waiting = 0) {
    return tracker_.track({index, 0.1 * static_cast<double>(index), std::move(features)}, waiting);
  }
  TrackResult track_world(std::int64_t index, double metres) {
    return track(index, see(world_, index, weaving_pose(metres)).features);
  }
  /// A frame that sees nothing near.
  std::shared_ptr<const FrameFeatures> far_only(std::int64_t index, double metres) {
    const auto seen = see(world_, index, weaving_pose(metres));
    FeatureSet far;
    std::vector<float> u_right;
    for (std::size_t i = 0; i < seen.features->size() && far.keypoints.size() < 40; ++i) {
      if (seen.features->depth(i) < 35) continue;
      far.keypoints.push_back(seen.features->keypoint(i));
      far.descriptors.push_back(seen.features->descriptor(i));
      u_right.push_back(seen.features->u_right(i));
    }
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(far),
                                                 std::move(u_right), std::vector<kys::Prior>{});
  }
  /// A part of what is seen: `right` features where they are, and five times as many 3.5 px from
  /// there, each in another direction.
  std::shared_ptr<const FrameFeatures> mostly_wrong(std::int64_t index, double metres,
                                                    std::size_t right) {
    const auto seen = see(world_, index, weaving_pose(metres));
    FeatureSet part;
    std::vector<float> u_right;
    for (std::size_t i = 0; i < seen.features->size() && part.keypoints.size() < 6 * right; ++i) {
      if (!seen.features->has_stereo(i)) continue;
      Keypoint k = seen.features->keypoint(i);
      const std::size_t count = part.keypoints.size();
      const float away = count % 6 == 0 ? 0 : 3.5f;
      k.x += away * std::cos(static_cast<float>(count));
      k.y += away * std::sin(static_cast<float>(count));
      part.keypoints.push_back(k);
      part.descriptors.push_back(seen.features->descriptor(i));
      u_right.push_back(seen.features->u_right(i) + k.x - seen.features->keypoint(i).x);
    }
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(part),
                                                 std::move(u_right), std::vector<kys::Prior>{});
  }
  /// What is seen of the world, and a truck 8 m ahead that keeps its place in the image.
  std::shared_ptr<const FrameFeatures> behind_truck(std::int64_t index, double metres) {
    const auto seen = see(world_, index, weaving_pose(metres));
    FeatureSet all;
    std::vector<float> u_right;
    const auto on_truck = [](const Keypoint& k) {
      return k.x > 450 && k.x < 750 && k.y > 60 && k.y < 300;
    };
    for (std::size_t i = 0; i < seen.features->size(); ++i) {
      if (on_truck(seen.features->keypoint(i))) continue;
      all.keypoints.push_back(seen.features->keypoint(i));
      all.descriptors.push_back(seen.features->descriptor(i));
      u_right.push_back(seen.features->u_right(i));
    }
    const StereoCamera camera = testing::kitti_camera();
    const auto truck = testing::random_features(camera, 2000, 5, 1.0);
    for (std::size_t i = 0; i < truck->size(); ++i) {
      if (!on_truck(truck->keypoint(i))) continue;
      all.keypoints.push_back(truck->keypoint(i));
      all.descriptors.push_back(truck->descriptor(i));
      u_right.push_back(truck->keypoint(i).x - static_cast<float>(camera.bf() / 8));
    }
    return std::make_shared<const FrameFeatures>(camera, std::move(all), std::move(u_right),
                                                 std::vector<kys::Prior>{});
  }
  /// The truck alone, `aside` m to the right of its place: it fills the image.
  static std::shared_ptr<const FrameFeatures> truck_alone(float aside) {
    const StereoCamera camera = testing::kitti_camera();
    const auto truck = testing::random_features(camera, 2000, 5, 1.0);
    FeatureSet seen;
    std::vector<float> u_right;
    for (std::size_t i = 0; i < truck->size(); ++i) {
      Keypoint k = truck->keypoint(i);
      if (!(k.x > 450 && k.x < 750 && k.y > 60 && k.y < 300)) continue;
      k.x += static_cast<float>(camera.fx) * aside / 8;
      seen.keypoints.push_back(k);
      seen.descriptors.push_back(truck->descriptor(i));
      u_right.push_back(k.x - static_cast<float>(camera.bf() / 8));
    }
    return std::make_shared<const FrameFeatures>(camera, std::move(seen), std::move(u_right),
                                                 std::vector<kys::Prior>{});
  }
  /// What is seen of the world, but in the middle of the image, which shows another part of it, as
  /// a camera at `middle_metres` sees it. The middle is 300 px wide and `height` px high.
  std::shared_ptr<const FrameFeatures> with_middle(std::int64_t index, double metres,
                                                   double middle_metres, float height) {
    FeatureSet all;
    std::vector<float> u_right;
    const auto add = [&](const FeatureWorld& world, double at, bool middle, std::size_t every) {
      const auto seen = see(world, index, weaving_pose(at));
      for (std::size_t i = 0; i < seen.features->size(); ++i) {
        const Keypoint& k = seen.features->keypoint(i);
        const bool inside = k.x > 470 && k.x < 770 && std::abs(k.y - 185) < height / 2;
        if (inside != middle || seen.features->descriptor(i).words[0] % every != 0) continue;
        all.keypoints.push_back(k);
        all.descriptors.push_back(seen.features->descriptor(i));
        u_right.push_back(seen.features->u_right(i));
      }
    };
    add(world_, metres, false, 1);
    add(world(2), middle_metres, true, 3);
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(all),
                                                 std::move(u_right), std::vector<kys::Prior>{});
  }
  /// Frame `i` of a camera that turns back at frame 12 while the middle of the image goes on: it is
  /// tracked at its true place.
  void turn_back(int i, double step, float height, TrackResult& result) {
    const double metres = step * (i < 12 ? i : 10);
    result = track(i, with_middle(i, metres, step * i, height));
    ASSERT_NE(result.status, TrackingStatus::kLost) << i << ": " << result.reason;
    EXPECT_LT((result.T_c_w.inverse().t() - truth(metres).t()).norm(), 0.02)
        << i << ": " << result.reason;
  }
  /// A place as relocalisation finds it: features with the landmarks of their descriptors.
  static KnownPlace known_place(const Tracker& tracker, KeyFrameId reference,
                                const FrameFeatures& features, const Rigid3& T_c_w) {
    KnownPlace place{reference, T_c_w, std::vector<LandmarkId>(features.size())};
    for (std::size_t i = 0; i < features.size(); ++i) {
      tracker.replica().landmarks().for_each([&](LandmarkId id, const LandmarkView& landmark) {
        if (kys::hamming(landmark.descriptor, features.descriptor(i)) < 30) place.landmarks[i] = id;
      });
    }
    return place;
  }
  /// The whole map is moved: keyframes and landmarks alike.
  [[nodiscard]] ChangeSet moved_map(const Rigid3& T_new_old) const {
    ChangeSet changes;
    tracker_.replica().keyframes().for_each([&](KeyFrameId id, const KeyFrameView& keyframe) {
      KeyFrameView moved = keyframe;
      moved.T_c_w = keyframe.T_c_w * T_new_old.inverse();
      changes.keyframes.emplace_back(id, moved);
    });
    tracker_.replica().landmarks().for_each([&](LandmarkId id, const LandmarkView& landmark) {
      LandmarkView moved = landmark;
      moved.p_w = T_new_old * landmark.p_w;
      moved.normal = (T_new_old.R() * landmark.normal.cast<double>()).cast<float>();
      changes.landmarks.emplace_back(id, moved);
    });
    return changes;
  }
  /// T_w_c of the truth relative to the first frame.
  static Rigid3 truth(double metres) { return weaving_pose(0).inverse() * weaving_pose(metres); }

  FeatureWorld world_ = world(1);
  kys::DistanceModel model_;
  Tracker tracker_{testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model_};
};

TEST_F(TrackerTest, StartsAMapOfAllStereoPointsAtTheOrigin) {
  const auto seen = see(world_, 0, weaving_pose(0));
  const TrackResult result = track(0, seen.features);
  EXPECT_EQ(result.status, TrackingStatus::kStarted);
  ASSERT_TRUE(result.keyframe.has_value());
  EXPECT_EQ(result.keyframe->id, KeyFrameId{0});
  EXPECT_EQ(result.keyframe->new_landmarks.size(), seen.features->size());
  EXPECT_FALSE(result.keyframe->reference.valid());
  EXPECT_LT(minus(result.T_c_w, Rigid3()).norm(), 1e-12);
  std::set<std::uint32_t> ids;
  for (const NewLandmark& landmark : result.keyframe->new_landmarks) {
    EXPECT_EQ(landmark.id.value % 2, 0u) << "odd ids are the back end's";
    EXPECT_TRUE(ids.insert(landmark.id.value).second);
    const Eigen::Vector3d expected =
        weaving_pose(0).inverse() * world_.points()[seen.points[landmark.feature]].p_w;
    EXPECT_LT((landmark.p_w - expected).norm(), 1e-3 * expected.norm());
  }
  EXPECT_EQ(tracker_.replica().landmarks().size(), ids.size());
}

TEST_F(TrackerTest, SaysWhyItCannotStart) {
  const auto without = see(world_, 0, weaving_pose(0), false);
  TrackResult result = track(0, without.features);
  EXPECT_EQ(result.status, TrackingStatus::kLost);
  EXPECT_EQ(result.reason, "too few stereo points to start a map: 0");
  EXPECT_FALSE(result.keyframe.has_value());
  EXPECT_FALSE(result.pose.reference.valid());
  result = track(1, testing::random_features(testing::kitti_camera(), 99, 5, 1.0));
  EXPECT_EQ(result.reason, "too few stereo points to start a map: 99");
  result = track_world(2, 0);
  EXPECT_EQ(result.status, TrackingStatus::kStarted) << "the first good frame starts it";
}

TEST_F(TrackerTest, FollowsTheCameraExactlyAndTellsHow) {
  track_world(0, 0);
  TrackResult result = track_world(1, 0.4);
  ASSERT_EQ(result.status, TrackingStatus::kTracked);
  EXPECT_EQ(result.reason, "reference keyframe") << "no velocity yet";
  EXPECT_LT((result.T_c_w.inverse().t() - truth(0.4).t()).norm(), 2e-3);
  for (int i = 2; i < 8; ++i) {
    result = track_world(i, 0.4 * i);
    ASSERT_EQ(result.status, TrackingStatus::kTracked);
    EXPECT_EQ(result.reason, "motion model");
    EXPECT_LT((result.T_c_w.inverse().t() - truth(0.4 * i).t()).norm(), 2e-3);
    EXPECT_GE(result.matches, result.inliers);
    EXPECT_LT(minus(tracker_.current_pose(result.pose), result.T_c_w).norm(), 1e-9);
  }
}

TEST_F(TrackerTest, ACameraThatTurnsBackAtOnceDoesNotFollowWhatTurnsBackWithIt) {
  constexpr double kStep = 0.86;
  for (int i = 0; i < 24; ++i) {
    const double metres = kStep * (i < 12 ? i : 22 - i);
    const TrackResult result = track(i, behind_truck(i, metres));
    ASSERT_NE(result.status, TrackingStatus::kLost) << i << ": " << result.reason;
    EXPECT_LT((result.T_c_w.inverse().t() - truth(metres).t()).norm(), 0.02)
        << i << ": " << result.reason;
    if (i == 12) {
      EXPECT_EQ(result.reason, "impossible motion; local map");
    }
  }
}

TEST_F(TrackerTest, ATurnIsNotHiddenByWhatLooksAsIfTheCameraWentOn) {
  for (int i = 0; i <= 12; ++i) {
    TrackResult result;
    ASSERT_NO_FATAL_FAILURE(turn_back(i, 0.5, 190, result));
    EXPECT_EQ(result.jumped, i == 12) << i << ": " << result.reason;
    EXPECT_EQ(result.integrity.reason == IntegrityReason::kImpossibleMotion, i == 12) << i;
  }
}

TEST_F(TrackerTest, ASampleOfTheKeyframeDoesNotPreferThePoseItJudges) {
  for (int i = 0; i <= 12; ++i) {
    TrackResult result;
    ASSERT_NO_FATAL_FAILURE(turn_back(i, 0.3, 280, result));
  }
}

/// A truck in the map drives off before a camera that sees nothing else: it is no camera that went
/// three metres aside in a tenth of a second.
TEST_F(TrackerTest, WhatFillsTheImageAndMovesIsNotFollowed) {
  for (int i = 0; i < 4; ++i) {
    ASSERT_NE(track(i, behind_truck(i, 0.02 * i)).status, TrackingStatus::kLost);
  }
  const auto truck = truck_alone(3);
  const TrackResult lost = track(4, truck);
  EXPECT_EQ(lost.status, TrackingStatus::kLost) << lost.T_c_w.t().transpose();
  EXPECT_NE(lost.reason.find("reference keyframe; impossible motion"), std::string::npos)
      << lost.reason;
  EXPECT_TRUE(lost.jumped);

  const Rigid3 T_aside_w(Eigen::Quaterniond::Identity(), {3, 0, 0});
  const KnownPlace place = known_place(tracker_, {0}, *truck, T_aside_w);
  const TrackResult unfound = tracker_.resume({4, 0.4, truck}, place, 0);
  EXPECT_EQ(unfound.status, TrackingStatus::kLost);
  EXPECT_NE(unfound.reason.find("impossible motion"), std::string::npos) << unfound.reason;

  const TrackResult again = track_world(5, 0.1);
  ASSERT_EQ(again.status, TrackingStatus::kTracked) << again.reason;
  EXPECT_EQ(again.reason, "motion model");
  EXPECT_LT((again.T_c_w.inverse().t() - truth(0.1).t()).norm(), 0.02);
}

/// The same without a pose for a while: 15 m/s^2 lead 3.15 m away in 0.6 s, 4.2 m in 0.7 s.
TEST_F(TrackerTest, HowFarACameraCanBeGrowsWithTheTimeWithoutAPose) {
  for (int i = 0; i < 4; ++i) {
    ASSERT_NE(track(i, behind_truck(i, 0.02 * i)).status, TrackingStatus::kLost);
  }
  const TrackResult impossible = track(9, truck_alone(4));
  EXPECT_EQ(impossible.status, TrackingStatus::kLost) << impossible.T_c_w.t().transpose();
  const TrackResult result = track(10, truck_alone(3));
  EXPECT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_NEAR(result.T_c_w.t().x(), 3, 0.1);
}

TEST_F(TrackerTest, AnotherPlaceIsLostWithAReasonAndFoundAgain) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  const FeatureWorld elsewhere = world(77);
  const TrackResult lost = track(3, see(elsewhere, 3, weaving_pose(0)).features);
  EXPECT_EQ(lost.status, TrackingStatus::kLost);
  EXPECT_NE(lost.reason.find("motion model: "), std::string::npos) << lost.reason;
  EXPECT_NE(lost.reason.find("reference keyframe: "), std::string::npos) << lost.reason;
  EXPECT_NE(lost.reason.find(" matches"), std::string::npos) << lost.reason;
  EXPECT_FALSE(lost.keyframe.has_value());
  EXPECT_FALSE(lost.pose.reference.valid());

  const TrackResult nothing = track(
      4, std::make_shared<const FrameFeatures>(testing::kitti_camera(), FeatureSet{},
                                               std::vector<float>{}, std::vector<kys::Prior>{}));
  EXPECT_EQ(nothing.status, TrackingStatus::kLost);
  EXPECT_EQ(nothing.reason,
            "motion model: 0 matches; reference keyframe: 0 matches; points of the last frame: 0 "
            "inliers");

  const TrackResult again = track_world(5, 2.0);
  EXPECT_EQ(again.status, TrackingStatus::kTracked);
  EXPECT_EQ(again.reason, "motion model") << "constant velocity goes on where frames are lost";
  EXPECT_LT((again.T_c_w.inverse().t() - truth(2.0).t()).norm(), 2e-3);
}

TEST_F(TrackerTest, TheMotionModelEndsHalfASecondAfterTheLastPose) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  const auto nothing = std::make_shared<const FrameFeatures>(
      testing::kitti_camera(), FeatureSet{}, std::vector<float>{}, std::vector<kys::Prior>{});
  for (int i = 3; i < 8; ++i) EXPECT_EQ(track(i, nothing).status, TrackingStatus::kLost);
  const TrackResult again = track_world(8, 1.2);
  EXPECT_EQ(again.status, TrackingStatus::kTracked);
  EXPECT_EQ(again.reason, "reference keyframe");
}

/// Far landmarks alone do not tell how far the camera goes: its last velocity does.
TEST_F(TrackerTest, ConstantVelocityHoldsAPoseThatFewMatchesHold) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  const TrackResult result = track(3, far_only(3, 1.2));
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_TRUE(result.held);
  EXPECT_EQ(result.reason, "motion model; held by constant velocity");
  EXPECT_LT((result.T_c_w.inverse().t() - truth(1.2).t()).norm(), 0.03);
  ASSERT_TRUE(result.keyframe);
  ASSERT_TRUE(result.keyframe->motion) << "it holds the keyframe in the map as well";
  const ExpectedMotion& motion = *result.keyframe->motion;
  const double from = 0.4 * motion.reference.value;
  EXPECT_LT((motion.T_c_reference.inverse().t() - (truth(from).inverse() * truth(1.2)).t()).norm(),
            0.03);
  EXPECT_GT(motion.sigma_position, 0);
  EXPECT_LT(motion.sigma_position, 0.1);
  EXPECT_FALSE(track_world(4, 1.6).held) << "not where enough else holds it";
}

/// Pictures are missing and most matches are wrong, but far more fit the expected pose than wrong
/// ones do by chance.
TEST_F(TrackerTest, FewInliersSufficeAtTheExpectedPose) {
  track_world(0, 0);
  track_world(1, 1);
  track_world(2, 2);
  const TrackResult result = tracker_.track({3, 0.5, mostly_wrong(5, 5, 20)}, 0);
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_LT(result.inliers, 0.4 * result.matches) << "the test needs wrong matches";
  EXPECT_LT(result.inliers, TrackerOptions().min_local_inliers);
  EXPECT_LT((result.T_c_w.inverse().t() - truth(5).t()).norm(), 0.03);
}

/// Features of the frame that `keep` says yes to; with `worn` their descriptors are 60 bits off.
template <typename Keep>
void add_features(const FrameFeatures& from, bool worn, const Keep& keep, FeatureSet& set,
                  std::vector<float>& u_right) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    kys::Descriptor descriptor = from.descriptor(i);
    if (!keep(descriptor)) continue;
    if (worn) descriptor.words[1] ^= (std::uint64_t{1} << 60) - 1;
    set.keypoints.push_back(from.keypoint(i));
    set.descriptors.push_back(descriptor);
    u_right.push_back(from.u_right(i));
  }
}

/// The last frame was no keyframe and shares no landmark with the next one, but points that are in
/// no keyframe. The map's landmarks look too different to be found without a prediction.
TEST_F(TrackerTest, PointsOfTheLastFrameGiveAPoseWhenItsLandmarksAreGone) {
  const FeatureWorld others = world(5);
  const auto frame_of = [&](std::int64_t index, double metres, std::uint64_t parity, bool worn) {
    FeatureSet set;
    std::vector<float> u_right;
    const auto half = [&](const kys::Descriptor& d) { return d.words[0] % 2 == parity; };
    const auto few = [](const kys::Descriptor& d) { return d.words[0] % 8 == 0; };
    add_features(*see(world_, index, weaving_pose(metres)).features, worn, half, set, u_right);
    add_features(*see(others, index, weaving_pose(metres)).features, false, few, set, u_right);
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(set),
                                                 std::move(u_right), std::vector<kys::Prior>{});
  };
  track_world(0, 0);
  track_world(1, 0.5);
  const TrackResult last = track(2, frame_of(2, 1, 0, false), 100);
  ASSERT_EQ(last.status, TrackingStatus::kTracked) << last.reason;
  ASSERT_FALSE(last.keyframe) << "the test needs points without landmarks";
  const TrackResult result = track(3, frame_of(3, 1.5, 1, true));
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_NE(result.reason.find("points of the last frame"), std::string::npos) << result.reason;
  EXPECT_LT((result.T_c_w.inverse().t() - truth(1.5).t()).norm(), 0.02);
}

/// The pose before a loss may be wrong, or of another sub-map.
TEST_F(TrackerTest, ARelocalisedFrameHasNoVelocity) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  EXPECT_EQ(track(3, see(world(77), 3, weaving_pose(0)).features).status, TrackingStatus::kLost);
  const auto seen = see(world_, 3, weaving_pose(1.2)).features;
  const TrackResult again =
      tracker_.resume({3, 0.3, seen}, known_place(tracker_, {0}, *seen, truth(1.2).inverse()), 0);
  ASSERT_EQ(again.status, TrackingStatus::kTracked) << again.reason;
  EXPECT_EQ(track_world(4, 1.6).reason, "reference keyframe");
  EXPECT_EQ(track_world(5, 2.0).reason, "motion model");
}

/// Between a frame that is lost and its relocalisation the back end may close a loop.
TEST_F(TrackerTest, ARelocalisedFrameIsComparedWithWhereTheLastOneIsInTheMovedMap) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  EXPECT_EQ(track(3, see(world(77), 3, weaving_pose(0)).features).status, TrackingStatus::kLost);
  const Rigid3 T_new_old(so3_exp({0, 0.3, 0}), {5, 0, -2});
  tracker_.apply(moved_map(T_new_old));
  const auto seen = see(world_, 3, weaving_pose(1.2)).features;
  const Rigid3 T_w_c = T_new_old * truth(1.2);
  const TrackResult again =
      tracker_.resume({3, 0.3, seen}, known_place(tracker_, {0}, *seen, T_w_c.inverse()), 0);
  ASSERT_EQ(again.status, TrackingStatus::kTracked) << again.reason;
  EXPECT_FALSE(again.jumped);
  EXPECT_LT((again.T_c_w.inverse().t() - T_w_c.t()).norm(), 2e-3);
}

/// The camera went on while its image repeated, and that image was lost besides.
TEST_F(TrackerTest, ALostRepeatedImageDoesNotStopTheCamera) {
  for (int i = 0; i < 3; ++i) track_world(i, 2.0 * i);
  const auto nothing = std::make_shared<const FrameFeatures>(
      testing::kitti_camera(), FeatureSet{}, std::vector<float>{}, std::vector<kys::Prior>{});
  EXPECT_EQ(tracker_.track({3, 0.3, nothing, nullptr, true}, 0).status, TrackingStatus::kLost);
  const TrackResult result = track_world(4, 8.0);
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_EQ(result.reason, "motion model");
}

/// After a repeated image the camera has gone two steps, and the next step is a single one again.
TEST_F(TrackerTest, TheMotionModelCountsTheTimeBetweenImages) {
  constexpr double kStep = 3;
  for (int i = 0; i < 3; ++i) track_world(i, kStep * i);
  const auto repeated = see(world_, 2, weaving_pose(2 * kStep)).features;
  const TrackResult same = tracker_.track({3, 0.3, repeated, nullptr, true}, 0);
  ASSERT_EQ(same.status, TrackingStatus::kTracked) << same.reason;
  EXPECT_EQ(same.taken, 0.2);
  EXPECT_LT((same.T_c_w.inverse().t() - truth(2 * kStep).t()).norm(), 2e-3);
  for (int i = 4; i < 6; ++i) {
    const TrackResult result = track_world(i, kStep * i);
    ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
    EXPECT_EQ(result.reason, "motion model") << i;
    EXPECT_FALSE(result.jumped) << i;
    EXPECT_EQ(result.taken, 0.1 * i);
    EXPECT_LT((result.T_c_w.inverse().t() - truth(kStep * i).t()).norm(), 0.01) << i;
  }
}

/// A camera with a high rate repeats an image many times in half a second: it may go on meanwhile.
/// Whoever shows the same for longer stands still.
TEST_F(TrackerTest, ARepeatedImageStopsTheCameraAfterHalfASecond) {
  const auto track_step = [&](int index, double metres, bool repeated = false) {
    const auto seen = see(world_, index, weaving_pose(metres)).features;
    return tracker_.track({index, 0.05 * index, seen, nullptr, repeated}, 0);
  };
  int i = 0;
  for (; i < 4; ++i) track_step(i, 0.5 * i);
  for (; i < 12; ++i) EXPECT_EQ(track_step(i, 1.5, true).taken, 0.05 * 3) << i;
  TrackResult result = track_step(i, 0.5 * i);
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_EQ(result.reason, "motion model");
  EXPECT_LT((result.T_c_w.inverse().t() - truth(0.5 * i).t()).norm(), 0.01);
  for (++i; i < 24; ++i) result = track_step(i, 6, true);
  EXPECT_GT(result.taken, 1);
  result = track_step(i, 6.2);
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_EQ(result.reason, "motion model");
  EXPECT_LT((result.T_c_w.inverse().t() - truth(6.2).t()).norm(), 0.01);
}

/// The same where the recording has no file for a frame.
TEST_F(TrackerTest, TheStepAfterAMissingImageIsASingleOne) {
  constexpr double kStep = 3;
  int index = 0;
  for (const int i : {0, 1, 2, 4, 5}) {
    const auto seen = see(world_, i, weaving_pose(kStep * i)).features;
    const TrackResult result = tracker_.track({index++, 0.1 * i, seen}, 0);
    ASSERT_NE(result.status, TrackingStatus::kLost) << i << ": " << result.reason;
    EXPECT_FALSE(result.jumped) << i;
    EXPECT_EQ(result.reason, i > 1 ? "motion model" : i > 0 ? "reference keyframe" : "start");
  }
}

/// In a map of one keyframe a keyframe is due later than in one of many, also when none of these is
/// of this run.
TEST_F(TrackerTest, ALoadedMapHasItsKeyframes) {
  ChangeSet map;
  int frame = 0;
  for (double metres = 0; tracker_.replica().keyframes().size() < 4; metres += 0.4) {
    ASSERT_NE(track_world(frame++, metres).status, TrackingStatus::kLost);
  }
  tracker_.replica().keyframes().for_each(
      [&](KeyFrameId id, const KeyFrameView& view) { map.keyframes.emplace_back(id, view); });
  tracker_.replica().landmarks().for_each(
      [&](LandmarkId id, const LandmarkView& view) { map.landmarks.emplace_back(id, view); });
  const KeyFrameId last = map.keyframes.back().first;
  const Rigid3 T_c_w = tracker_.replica().keyframes().at(last).T_c_w;
  const double start = 0.4 * (frame - 1);

  Tracker later(testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model_);
  later.continue_map(tracker_.replica().keyframes().id_end(),
                     tracker_.replica().landmarks().id_end(), false);
  later.apply(map);
  const auto first = see(world_, 0, weaving_pose(start)).features;
  const TrackResult found = later.resume({0, 0, first}, known_place(later, last, *first, T_c_w), 0);
  ASSERT_EQ(found.status, TrackingStatus::kTracked) << found.reason;
  // Frames until the next keyframe, as the first run counts them and as the second does.
  const auto next_keyframe = [&](Tracker& tracker, int from) {
    for (int i = 1; i < 60; ++i) {
      const auto seen = see(world_, from + i, weaving_pose(start + 0.4 * i)).features;
      if (tracker.track({from + i, 0.1 * (from + i), seen}, 0).keyframe) return i;
    }
    return 60;
  };
  EXPECT_NEAR(next_keyframe(later, 0), next_keyframe(tracker_, frame - 1), 1);
}

/// A velocity is that of the camera, whatever world the last frames were in.
TEST_F(TrackerTest, ASubmapStartsWithTheLastVelocity) {
  track_world(0, 0);
  track_world(1, 0.4);
  track_world(2, 0.8);
  const auto nothing = std::make_shared<const FrameFeatures>(
      testing::kitti_camera(), FeatureSet{}, std::vector<float>{}, std::vector<kys::Prior>{});
  EXPECT_EQ(track(3, nothing).status, TrackingStatus::kLost);
  const auto seen = see(world_, 4, weaving_pose(1.6));
  const TrackResult start = tracker_.start_submap({4, 0.4, seen.features});
  ASSERT_EQ(start.status, TrackingStatus::kStarted) << start.reason;
  const TrackResult result = track(5, far_only(5, 2.0));
  ASSERT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
  EXPECT_EQ(result.reason, "motion model") << "not the reference keyframe";
  EXPECT_NEAR(result.T_c_w.t().norm(), 0.4, 0.1);
}

TEST_F(TrackerTest, TheGateKnowsThatALandmarkOfOneKeyframeIsAsNoisyAsAKeypoint) {
  FeatureWorld::Options noisy;
  noisy.aligned = true;
  noisy.pixel_noise = kAlignedSigma;
  const FeatureWorld world(testing::kitti_camera(), noisy);
  // Twice the variance of a keypoint, of which the gate knows 1, 1.5 and 2: the chi-square
  // distribution of three degrees of freedom at 7.815 times 1/2, 1.5/2 and 1.
  const std::vector<std::pair<double, double>> expected = {{0, 0.728}, {0.5, 0.881}, {1, 0.95}};
  for (const auto& [noise, share] : expected) {
    TrackerOptions options;
    options.landmark_noise = noise;
    tracker_ = Tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), options, model_);
    track(0, testing::all_aligned(*see(world, 0, weaving_pose(0)).features));
    const TrackResult result =
        track(1, testing::all_aligned(*see(world, 1, weaving_pose(0.2)).features));
    ASSERT_GT(result.matches, 500);
    EXPECT_NEAR(result.inliers / static_cast<double>(result.matches), share, 0.04) << noise;
  }
}

TEST_F(TrackerTest, AFrameThatFitsTheMapPoorlyIsLostWithItsInliers) {
  TrackerOptions options;
  options.motion.acceleration = 0;
  tracker_ = Tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), options, model_);
  track_world(0, 0);
  track_world(1, 0.4);
  // Twenty-five of the features are all that is seen, and nothing else holds the pose.
  const auto seen = see(world_, 2, weaving_pose(0.8));
  FeatureSet few{{seen.features->keypoints().begin(), seen.features->keypoints().begin() + 25},
                 {seen.features->descriptors().begin(), seen.features->descriptors().begin() + 25}};
  std::vector<float> u_right;
  for (std::size_t i = 0; i < 25; ++i) u_right.push_back(seen.features->u_right(i));
  const TrackResult result = track(
      2, std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(few),
                                               std::move(u_right), std::vector<kys::Prior>{}));
  EXPECT_EQ(result.status, TrackingStatus::kLost);
  EXPECT_NE(result.reason.find("inliers"), std::string::npos) << result.reason;
  EXPECT_LT(result.inliers, 30);
}

TEST_F(TrackerTest, AKeyframeEntersTheReplicaAtOnceAndCarriesCounts) {
  track_world(0, 0);
  std::optional<KeyFrameMessage> message;
  for (int i = 1; i < 40 && !message; ++i) message = track_world(i, 0.8 * i).keyframe;
  ASSERT_TRUE(message.has_value()) << "30 m on, the first view must be out of sight";
  EXPECT_EQ(message->id, KeyFrameId{1});
  EXPECT_EQ(message->reference, KeyFrameId{0});
  const KeyFrameView* view = tracker_.replica().keyframes().find(message->id);
  ASSERT_NE(view, nullptr);
  EXPECT_EQ(view->parent, KeyFrameId{0});
  EXPECT_LT(
      minus(message->T_c_reference * tracker_.replica().keyframes().at({0}).T_c_w, message->T_c_w)
          .norm(),
      1e-9);
  EXPECT_FALSE(message->counts.empty());
  for (const VisibilityCount& count : message->counts) EXPECT_LE(count.found, count.visible);
  int tracked = 0;
  for (const LandmarkId id : message->tracked) tracked += id.valid() ? 1 : 0;
  EXPECT_GT(tracked, 15);
  for (const NewLandmark& landmark : message->new_landmarks) {
    EXPECT_FALSE(message->tracked[landmark.feature].valid()) << "its feature was free";
    EXPECT_EQ(view->landmarks[landmark.feature], landmark.id);
  }
}

TEST_F(TrackerTest, PosesFollowWhenTheBackEndMovesTheMap) {
  track_world(0, 0);
  const TrackResult before = track_world(1, 0.4);
  const Rigid3 T_new_old(so3_exp({0, 0.3, 0}), {5, 0, -2});
  tracker_.apply(moved_map(T_new_old));
  EXPECT_LT(minus(tracker_.current_pose(before.pose).inverse(), T_new_old * before.T_c_w.inverse())
                .norm(),
            1e-9);
  const TrackResult after = track_world(2, 0.8);
  ASSERT_EQ(after.status, TrackingStatus::kTracked);
  EXPECT_LT((after.T_c_w.inverse().t() - (T_new_old * truth(0.8)).t()).norm(), 2e-3);
}

/// Frames whose every keypoint has one prior.
class TrackerWithPriors : public TrackerTest {
 protected:
  static std::shared_ptr<const FrameFeatures> labelled(const FrameFeatures& from,
                                                       const kys::Prior& prior) {
    return std::make_shared<const FrameFeatures>(
        from.with_priors(std::vector<kys::Prior>(from.size(), prior)));
  }
  /// The second frame, which is searched from the reference keyframe, when both frames' keypoints
  /// lie on `seen` and every landmark got another prior in between.
  TrackResult after_landmarks_got(const kys::Prior& seen, const kys::Prior& landmark_prior,
                                  const kys::DistanceModel& model) {
    Tracker tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model);
    tracker.track({0, 0, labelled(*see(world_, 0, weaving_pose(0)).features, seen)}, 0);
    ChangeSet changes;
    tracker.replica().landmarks().for_each([&](LandmarkId id, const LandmarkView& landmark) {
      LandmarkView other = landmark;
      other.prior = landmark_prior;
      changes.landmarks.emplace_back(id, other);
    });
    tracker.apply(changes);
    return tracker.track({1, 0.1, labelled(*see(world_, 1, weaving_pose(0.4)).features, seen)}, 0);
  }
};

TEST_F(TrackerWithPriors, TheReferenceKeyframesDescriptorGoesWithItsOwnLabel) {
  kys::ModeOptions options;
  options.mode = kys::Mode::kHardMismatch;
  const kys::DistanceModel model(options);
  const kys::Prior car = kys::make_prior(2, 7, 1, 0, false);
  const kys::Prior road = kys::make_prior(1, 1, 1, 0, false);
  const TrackResult result = after_landmarks_got(car, road, model);
  EXPECT_EQ(result.status, TrackingStatus::kTracked) << result.reason;
}

TEST_F(TrackerWithPriors, TheReferenceKeyframesLandmarksMoveAsLastSeen) {
  kys::ModeOptions options;
  options.mode = kys::Mode::kKys;
  options.continuous = false;  // gates alone
  const kys::DistanceModel model(options);
  const kys::Prior still = kys::make_prior(2, 7, 1, 0, false);
  const kys::Prior fast = kys::make_prior(2, 7, 1, 50, true);
  EXPECT_EQ(after_landmarks_got(still, still, model).status, TrackingStatus::kTracked);
  EXPECT_EQ(after_landmarks_got(still, fast, model).status, TrackingStatus::kLost);
}

/// A file calls a suitcase moving; the gate asks what is believed of it.
TEST_F(TrackerWithPriors, FeaturesToRelocaliseHaveBeliefs) {
  const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  const auto flagged = labelled(*see(world_, 0, weaving_pose(0)).features,
                                kys::make_prior(space.index_of("suitcase"), 7, 1, 90, true));
  for (const kys::Mode mode : {kys::Mode::kKys, kys::Mode::kVerified}) {
    kys::ModeOptions options;
    options.mode = mode;
    const kys::DistanceModel model(options, space);
    Tracker tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model,
                    kys::InitialBelief({}, space));
    tracker.track({0, 0, flagged}, 0);
    const bool gated =
        !model.admits(tracker.with_beliefs(flagged)->prior(0), kys::Context::kTemporal);
    EXPECT_EQ(gated, mode == kys::Mode::kKys);
    EXPECT_EQ(tracker.with_belief(flagged->prior(0)), tracker.with_beliefs(flagged)->prior(0));
  }
}

/// Everything in view is on one thing. It is compared with earlier images, over the time since
/// the camera took them: a whole number of steps, whatever the time stamps.
TEST_F(TrackerWithPriors, ThingsAreJudgedByTheTimesOfImages) {
  const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  kys::ModeOptions options;
  options.mode = kys::Mode::kVerified;
  const kys::DistanceModel model(options, space);
  Tracker tracker(testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), model,
                  kys::InitialBelief({}, space));
  const kys::Prior thing = kys::make_prior(space.index_of("suitcase"), 70000, 1, 0, false);
  const auto track_thing = [&](int index, double time, double metres, bool repeated) {
    const auto seen = labelled(*see(world_, index, weaving_pose(metres)).features, thing);
    return tracker.track({index, time, seen, nullptr, repeated}, 0);
  };
  // Every third stamp is 40 ms late; the image of frame 21 is there twice.
  for (int i = 0; i < 25; ++i) {
    const bool repeated = i == 22;
    const TrackResult result =
        track_thing(i, 0.1 * i + 0.04 * (i % 3 == 2 ? 1 : 0), 0.3 * (repeated ? 21 : i), repeated);
    ASSERT_NE(result.status, TrackingStatus::kLost) << i << ": " << result.reason;
    ASSERT_EQ(result.instances.size(), 1u);
    if (i < 18) continue;  // the clock has to see some stamps first
    const double steps = result.instances[0].span / 0.1;
    EXPECT_NEAR(steps, std::round(steps), 0.2) << i;
    EXPECT_EQ(steps == 0, repeated) << i;
  }
}

TEST(TrackerOptions, OnesThatMakeNoSenseAreNamed) {
  TrackerOptions options;
  options.close_baselines = -1;
  try {
    check_options(options);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "tracking.close_baselines must be between 1 and 1000000, is -1");
  }
}

}  // namespace
}  // namespace kys_slam
