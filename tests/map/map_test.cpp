// SPDX-License-Identifier: BSD-3-Clause
#include "map/map.h"

#include <gtest/gtest.h>
#include <kys/hamming.h>
#include <kys/prior.h>

#include <algorithm>
#include <functional>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::kf;
using testing::lm;
using testing::make_keyframe;
using testing::make_landmark;
using testing::random_features;

Map empty_map() {
  return {testing::kitti_camera(), ScaleLevels(1.2, 8)};
}

/// Keyframes 0..n-1 with 60 stereo features each, one metre apart along z.
/// \param instance_of by keyframe and feature; none: without priors
Map chain(std::uint32_t n, const std::function<int(std::uint32_t, std::size_t)>& instance_of = {}) {
  Map map = empty_map();
  for (std::uint32_t k = 0; k < n; ++k) {
    auto features = random_features(map.camera(), 60, k + 1, 1.0);
    if (instance_of) {
      std::vector<kys::Prior> priors;
      for (std::size_t i = 0; i < features->size(); ++i) {
        priors.push_back(kys::make_prior(2, instance_of(k, i), 10, 1, false));
      }
      features = std::make_shared<const FrameFeatures>(features->with_priors(std::move(priors)));
    }
    map.add_keyframe(make_keyframe(
        k, std::move(features),
        Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -static_cast<double>(k)))));
  }
  return map;
}

/// Landmark `id` seen by feature `feature` of each of these keyframes.
void see(Map& map, std::uint32_t id, std::uint32_t feature,
         std::initializer_list<std::uint32_t> keyframes) {
  map.add_landmark(make_landmark(id, {1.0 + id, 0.5, 20}));
  for (const std::uint32_t k : keyframes) {
    ASSERT_TRUE(map.add_observation(lm(id), kf(k), feature));
  }
  map.refresh_landmark(lm(id));
}

int weight(const Map& map, std::uint32_t a, std::uint32_t b) {
  for (const Covisible& c : map.keyframe(kf(a)).covisible) {
    if (c.keyframe == kf(b)) return c.weight;
  }
  return 0;
}

TEST(Map, CountsWhatKeyframesShare) {
  Map map = chain(3);
  for (std::uint32_t i = 0; i < 20; ++i) see(map, i, i, {0, 1});
  for (std::uint32_t i = 20; i < 30; ++i) see(map, i, i, {0, 1, 2});
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.connect_to_spanning_tree(kf(2), kf(1));
  map.check_consistency();
  EXPECT_EQ(weight(map, 0, 1), 30);
  EXPECT_EQ(weight(map, 1, 0), 30);
  EXPECT_EQ(weight(map, 0, 2), 10);
  EXPECT_EQ(map.observation_weight(lm(25)), 6) << "three stereo observations";
  EXPECT_EQ(map.best_covisible(kf(0), 10), std::vector<KeyFrameId>{kf(1)}) << "10 < 15 shared";
  EXPECT_EQ(map.best_covisible(kf(0), 10, 1), (std::vector<KeyFrameId>{kf(1), kf(2)}));
  EXPECT_EQ(map.best_covisible(kf(2), 10), std::vector<KeyFrameId>{kf(0)})
      << "none is heavy: the heaviest alone, of equals the older";
  EXPECT_EQ(map.keyframe(kf(2)).parent, kf(1)) << "of equals the younger";
}

TEST(Map, AKeyframeConnectedAgainLeavesItsFormerParent) {
  Map map = chain(3);
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.connect_to_spanning_tree(kf(2), kf(0));
  see(map, 0, 0, {1, 2});
  map.connect_to_spanning_tree(kf(2), kf(0));
  EXPECT_EQ(map.keyframe(kf(2)).parent, kf(1));
  EXPECT_EQ(map.keyframe(kf(0)).children, std::vector<KeyFrameId>{kf(1)});
  map.check_consistency();
}

TEST(Map, RefusesASecondObservationOfAFeatureOrOfALandmarkInOneKeyframe) {
  Map map = chain(2);
  see(map, 0, 0, {0, 1});
  map.add_landmark(make_landmark(1, {0, 0, 5}));
  EXPECT_FALSE(map.add_observation(lm(1), kf(0), 0)) << "the feature is taken";
  EXPECT_FALSE(map.add_observation(lm(0), kf(0), 5)) << "the keyframe sees it already";
  EXPECT_TRUE(map.add_observation(lm(1), kf(0), 1));
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.check_consistency();
}

TEST(Map, ErasesALandmarkThatTooFewSee) {
  Map map = chain(3);
  see(map, 0, 0, {0, 1, 2});
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.connect_to_spanning_tree(kf(2), kf(1));
  map.remove_observation(lm(0), kf(0));
  ASSERT_TRUE(map.has(lm(0))) << "two stereo observations are left";
  EXPECT_EQ(map.landmark(lm(0)).reference, kf(1)) << "its reference saw it no longer";
  EXPECT_EQ(weight(map, 0, 1), 0);
  EXPECT_FALSE(map.keyframe(kf(0)).landmarks[0].valid());
  map.remove_observation(lm(0), kf(2));
  EXPECT_FALSE(map.has(lm(0))) << "one stereo observation weighs 2: too little";
  EXPECT_FALSE(map.keyframe(kf(1)).landmarks[0].valid());
  EXPECT_TRUE(map.keyframe(kf(1)).covisible.empty());
  map.check_consistency();
}

TEST(Map, ReplacedLandmarksResolveToTheirSuccessor) {
  Map map = chain(4);
  see(map, 0, 0, {0, 1});
  see(map, 1, 1, {1, 2});
  see(map, 2, 2, {2, 3});
  for (std::uint32_t k = 1; k < 4; ++k) map.connect_to_spanning_tree(kf(k), kf(k - 1));
  map.add_visible(lm(0), 5, 3);
  map.replace_landmark(lm(0), lm(1));
  EXPECT_FALSE(map.has(lm(0)));
  EXPECT_EQ(map.resolve(lm(0)), lm(1));
  // Keyframe 0 sees the successor now; keyframe 1 already did, with another feature.
  EXPECT_EQ(map.keyframe(kf(0)).landmarks[0], lm(1));
  EXPECT_FALSE(map.keyframe(kf(1)).landmarks[0].valid());
  EXPECT_EQ(map.keyframe(kf(1)).landmarks[1], lm(1));
  EXPECT_EQ(map.landmark(lm(1)).observations.size(), 3u);
  EXPECT_EQ(map.landmark(lm(1)).visible, 1u + 6u);
  EXPECT_EQ(map.landmark(lm(1)).found, 1u + 4u);
  map.add_visible(lm(1), 70000, 60000);
  EXPECT_EQ(map.landmark(lm(1)).visible, 65535u) << "no more than it can hold";
  EXPECT_EQ(map.landmark(lm(1)).found, 60005u);
  map.check_consistency();
  map.replace_landmark(lm(1), lm(2));
  EXPECT_EQ(map.resolve(lm(0)), lm(2)) << "through two replacements";
  map.replace_landmark(lm(2), lm(2));
  EXPECT_TRUE(map.has(lm(2)));
  map.erase_landmark(lm(2));
  EXPECT_FALSE(map.resolve(lm(0)).valid());
  map.check_consistency();
}

TEST(Map, ChildrenOfACulledKeyframeFindNewParents) {
  // 0 - 1 - {2, 3, 4}; 3 shares much with 2, 4 with 0, and 2 with nobody but 1.
  Map map = chain(5);
  std::uint32_t id = 0;
  const auto share = [&](std::uint32_t a, std::uint32_t b, std::uint32_t from, std::uint32_t n) {
    for (std::uint32_t i = 0; i < n; ++i) see(map, id++, from + i, {a, b});
  };
  share(0, 1, 0, 5);
  share(1, 2, 5, 5);
  share(1, 3, 10, 5);
  share(1, 4, 15, 5);
  share(2, 3, 20, 4);
  share(0, 4, 30, 3);
  for (std::uint32_t k = 1; k < 5; ++k) map.connect_to_spanning_tree(kf(k), kf(0));
  ASSERT_EQ(map.keyframe(kf(1)).children, (std::vector<KeyFrameId>{kf(2), kf(3), kf(4)}));
  map.add_loop_edge(kf(1), kf(4));
  map.check_consistency();

  const Rigid3 before = *map.pose(kf(1));
  EXPECT_FALSE(map.cull_keyframe(kf(0))) << "the root stays";
  EXPECT_TRUE(map.cull_keyframe(kf(1)));
  map.check_consistency();
  EXPECT_FALSE(map.has(kf(1)));
  EXPECT_EQ(map.culled_parent(kf(1)), kf(0));
  EXPECT_FALSE(map.culled_parent(kf(2)).valid());
  EXPECT_EQ(map.keyframe(kf(2)).parent, kf(0)) << "shares nothing with those placed";
  EXPECT_EQ(map.keyframe(kf(3)).parent, kf(2)) << "its heaviest among those placed";
  EXPECT_EQ(map.keyframe(kf(4)).parent, kf(0));
  EXPECT_EQ(map.keyframe(kf(4)).loop_edges, std::vector<KeyFrameId>{kf(0)}) << "passed on";
  EXPECT_EQ(map.keyframe(kf(0)).loop_edges, std::vector<KeyFrameId>{kf(4)});

  // The culled keyframe moves with its parent.
  const Rigid3 after = *map.pose(kf(1));
  EXPECT_LT(minus(before, after).norm(), 1e-12);
  const Rigid3 T_new(so3_exp({0.1, -0.2, 0.3}), {1, 2, 3});
  map.set_pose(kf(0), T_new);
  const Rigid3 expected = before * Rigid3().inverse() * T_new;
  EXPECT_LT(minus(*map.pose(kf(1)), expected).norm(), 1e-12);
  EXPECT_FALSE(map.pose(kf(99)).has_value());
}

TEST(Map, PosesOfKeyframesCulledOneAfterTheOtherGoThroughAllParents) {
  Map map = chain(4);
  for (std::uint32_t k = 1; k < 4; ++k) {
    see(map, k, k, {k - 1, k});
    map.connect_to_spanning_tree(kf(k), kf(k - 1));
  }
  std::vector<Rigid3> before;
  for (std::uint32_t k = 0; k < 4; ++k) before.push_back(*map.pose(kf(k)));
  ASSERT_TRUE(map.cull_keyframe(kf(2)));
  ASSERT_TRUE(map.cull_keyframe(kf(1)));
  EXPECT_EQ(map.keyframe(kf(3)).parent, kf(0));
  map.check_consistency();
  for (std::uint32_t k = 0; k < 4; ++k) {
    EXPECT_LT(minus(*map.pose(kf(k)), before[k]).norm(), 1e-12) << k;
  }
  const Rigid3 move(so3_exp({0, 0.2, 0}), {0, 1, 0});
  map.set_pose(kf(0), before[0] * move);
  for (std::uint32_t k = 1; k < 3; ++k) {
    EXPECT_LT(minus(*map.pose(kf(k)), before[k] * move).norm(), 1e-12) << k;
  }
}

TEST(Map, LandmarkGeometryFollowsItsObservers) {
  Map map = chain(2);
  map.add_landmark(make_landmark(0, {3, 0, 4}));
  map.add_observation(lm(0), kf(0), 0);
  map.refresh_landmark(lm(0));
  const Landmark& landmark = map.landmark(lm(0));
  const int octave = map.keyframe(kf(0)).features->keypoint(0).octave;
  EXPECT_NEAR((landmark.normal - Eigen::Vector3f(0.6f, 0, 0.8f)).norm(), 0, 1e-6);
  EXPECT_NEAR(landmark.max_distance, 5 * std::pow(1.2, octave), 1e-4);
  EXPECT_NEAR(landmark.min_distance, landmark.max_distance / std::pow(1.2, 7), 1e-4);
  map.add_observation(lm(0), kf(1), 0);  // from (0, 0, 1)
  map.refresh_geometry(lm(0));
  const Eigen::Vector3d mean =
      (Eigen::Vector3d(3, 0, 4) / 5 + Eigen::Vector3d(3, 0, 3).normalized()).normalized();
  EXPECT_NEAR((map.landmark(lm(0)).normal.cast<double>() - mean).norm(), 0, 1e-6);
  EXPECT_NEAR(landmark.max_distance, 5 * std::pow(1.2, octave), 1e-4) << "the reference fixes it";
}

TEST(Map, RepresentativeDescriptorIsTheMostCentralOne) {
  Map map = empty_map();
  const auto with_descriptor = [&](std::uint64_t word) {
    FeatureSet set;
    set.keypoints = {{100, 100, 0, 1, 0}};
    set.descriptors.resize(1);
    set.descriptors[0].words[0] = word;
    return std::make_shared<const FrameFeatures>(map.camera(), set, std::vector<float>{90.0f},
                                                 std::vector<kys::Prior>{});
  };
  // Mutual distances: 0b0011 is within 2 of the two others near it; the two last are far from all.
  const std::uint64_t words[] = {0b0000, 0b0011, 0b1111, 0xFFFF0000, 0xFFFF000000000000};
  map.add_landmark(make_landmark(0, {0, 0, 10}));
  for (std::uint32_t k = 0; k < 5; ++k) {
    map.add_keyframe(make_keyframe(k, with_descriptor(words[k])));
    map.add_observation(lm(0), kf(k), 0);
  }
  map.refresh_landmark(lm(0));
  EXPECT_EQ(map.landmark(lm(0)).descriptor.words[0], words[1]);
}

TEST(Map, ALandmarksDescriptorIsThatOfLeastMedianDistanceAlsoAmongManyObservers) {
  for (std::uint32_t observers = 3; observers < 40; ++observers) {
    Map map = empty_map();
    map.add_landmark(make_landmark(0, {0, 0, 5}));
    std::vector<kys::Descriptor> descriptors;
    for (std::uint32_t k = 0; k < observers; ++k) {
      const unsigned seed = k % 3 == 0 ? observers : 1000 * observers + k;  // the same: ties
      const auto features = random_features(map.camera(), 1, seed, 0);
      descriptors.push_back(features->descriptor(0));
      map.add_keyframe(make_keyframe(k, features));
      ASSERT_TRUE(map.add_observation(lm(0), kf(k), 0));
    }
    map.refresh_landmark(lm(0));
    std::vector<int> medians;
    for (const kys::Descriptor& d : descriptors) {
      std::vector<int> row;
      for (const kys::Descriptor& other : descriptors) row.push_back(kys::hamming(d, other));
      std::sort(row.begin(), row.end());
      medians.push_back(row[(row.size() - 1) / 2]);
    }
    const auto least = std::min_element(medians.begin(), medians.end()) - medians.begin();
    EXPECT_EQ(map.landmark(lm(0)).descriptor, descriptors[static_cast<std::size_t>(least)])
        << observers;
  }
}

TEST(Map, DisparityOffsetReachesPresentAndFutureKeyframes) {
  Map map = chain(2);
  const float before = map.keyframe(kf(0)).features->u_right(3);
  map.set_rig(RigCorrection::of_offset(map.camera(), 0.5));
  EXPECT_FLOAT_EQ(map.keyframe(kf(0)).features->u_right(3), before - 0.5f);
  const auto later = random_features(map.camera(), 60, 99, 1.0);
  map.add_keyframe(make_keyframe(2, later));
  EXPECT_FLOAT_EQ(map.keyframe(kf(2)).features->u_right(3), later->u_right(3) - 0.5f);
  EXPECT_FLOAT_EQ(map.keyframe(kf(2)).features->rig().offset(), 0.5);
}

TEST(Map, AThinKeyframeKeepsTheFeaturesOfItsLandmarks) {
  Map map = chain(3);
  for (std::uint32_t i = 0; i < 20; ++i) see(map, i, 3 * i + 1, {0, 1, 2});
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.connect_to_spanning_tree(kf(2), kf(1));
  static_cast<void>(map.take_changes());
  const KeyFrame whole = map.keyframe(kf(1));
  const Landmark before = map.landmark(lm(7));

  EXPECT_EQ(map.thin_keyframe(kf(1)), 40u);
  EXPECT_EQ(map.thin_keyframe(kf(1)), 0u) << "nothing is left to drop";
  map.check_consistency();
  const KeyFrame& thin = map.keyframe(kf(1));
  ASSERT_EQ(thin.features->size(), 20u);
  EXPECT_EQ(whole.features->size(), 60u) << "who has the features keeps them";
  EXPECT_EQ(thin.covisible, whole.covisible);
  for (std::uint32_t i = 0; i < 20; ++i) {
    const std::size_t was = 3 * i + 1;
    EXPECT_EQ(thin.landmarks[i], lm(i));
    EXPECT_EQ(thin.features->keypoint(i), whole.features->keypoint(was));
    EXPECT_EQ(thin.features->descriptor(i), whole.features->descriptor(was));
    EXPECT_EQ(thin.features->u_right(i), whole.features->u_right(was));
    EXPECT_EQ(thin.features->depth(i), whole.features->depth(was));
    int found = 0;
    const Keypoint& k = thin.features->keypoint(i);
    thin.features->for_each_near(k.x, k.y, 0.5f, 0, 7, [&](std::size_t f) { found += f == i; });
    EXPECT_EQ(found, 1) << "feature " << i << " in the grid";
  }
  EXPECT_EQ(map.landmark(lm(7)).observations,
            (std::vector<Observation>{{kf(0), 22}, {kf(1), 7}, {kf(2), 22}}));
  map.refresh_landmark(lm(7));
  EXPECT_EQ(map.landmark(lm(7)).descriptor, before.descriptor);

  const ChangeSet changes = map.take_changes();
  ASSERT_EQ(changes.keyframes.size(), 1u) << "the tracker learns of it";
  EXPECT_EQ(changes.keyframes[0].second.features, thin.features);
  EXPECT_EQ(changes.keyframes[0].second.landmarks, thin.landmarks);
}

TEST(Map, ConsistencyCheckNoticesALandmarkNobodySees) {
  Map map = chain(1);
  map.check_consistency();
  map.add_landmark(make_landmark(0, {0, 0, 1}));
  EXPECT_THROW(map.check_consistency(), std::logic_error);
}

TEST(Map, ConsistencyCheckNoticesNumbersThatAreNotFinite) {
  Map map = chain(2);
  see(map, 0, 0, {0, 1});
  map.connect_to_spanning_tree(kf(1), kf(0));
  map.check_consistency();
  map.set_position(lm(0), {0, std::nan(""), 0});
  EXPECT_THROW(map.check_consistency(), std::logic_error);
}

/// Three keyframes; features 0-9 are of instance 5, the others of 7, but feature 9 of keyframes 1
/// and 2 is of 7 as well.
Map chain_on_instances() {
  return chain(3,
               [](std::uint32_t k, std::size_t i) { return i < 9 || (i == 9 && k == 0) ? 5 : 7; });
}

TEST(Map, BeliefsReachTheLandmarksOfTheirInstanceOnly) {
  for (const bool from_the_start : {true, false}) {
    Map map = chain_on_instances();
    if (from_the_start) map.keep_beliefs();
    for (std::uint32_t i = 0; i < 20; ++i) see(map, i, i, {0, 1});
    map.keep_beliefs();
    (void)map.take_changes();
    EXPECT_EQ(map.set_beliefs(std::vector<InstanceBelief>{{5, 0.25f, 0}, {6, 0.5f, 0}}, 1), 0);
    for (std::uint32_t i = 0; i < 20; ++i) {
      EXPECT_EQ(map.weight(map.landmark(lm(i))), i < 10 ? 0.25f : 0.99f) << i;
    }
    EXPECT_EQ(map.take_changes().landmarks.size(), 10u);
    EXPECT_EQ(map.set_beliefs(std::vector<InstanceBelief>{{5, 0.25f, 0}}, 1), 0);
    EXPECT_TRUE(map.take_changes().landmarks.empty()) << "nothing is new";
  }
}

TEST(Map, ALandmarkThatChangesItsInstanceFollowsTheBeliefOfTheNewOne) {
  Map map = chain_on_instances();
  map.keep_beliefs();
  for (std::uint32_t i = 8; i < 12; ++i) see(map, i, i, {0, 1});
  map.set_beliefs(std::vector<InstanceBelief>{{5, 0.25f, 0}, {7, 0.75f, 0}}, 1);
  EXPECT_EQ(map.weight(map.landmark(lm(9))), 0.25f);
  ASSERT_TRUE(map.add_observation(lm(9), kf(2), 9));
  map.remove_observation(lm(9), kf(0));
  map.refresh_landmark(lm(9));
  EXPECT_EQ(map.weight(map.landmark(lm(9))), 0.75f);
  EXPECT_EQ(map.set_beliefs(std::vector<InstanceBelief>{{5, 0.0f, 2}}, 1), 1);
  EXPECT_FALSE(map.has(lm(8))) << "it is on what has moved for long";
  EXPECT_TRUE(map.has(lm(9)));
  map.erase_landmark(lm(11));
  EXPECT_EQ(map.set_beliefs(std::vector<InstanceBelief>{{7, 0.0f, 2}}, 1), 2) << "9 and 10";
  EXPECT_EQ(map.landmarks().size(), 0u);
}

}  // namespace
}  // namespace kys_slam
