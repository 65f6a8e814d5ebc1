// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/culling.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::kf;
using testing::lm;
using testing::make_keyframe;
using testing::make_landmark;

/// `count` features of one octave with a disparity in px; 0: no stereo match.
std::shared_ptr<const FrameFeatures> plain_features(int count, int octave, float disparity) {
  FeatureSet set;
  std::vector<float> u_right;
  for (int i = 0; i < count; ++i) {
    const float x = 100 + 5 * static_cast<float>(i);
    set.keypoints.push_back({x, 100, 0, 20, static_cast<std::uint8_t>(octave)});
    u_right.push_back(disparity > 0 ? x - disparity : testing::kNoStereo);
  }
  set.descriptors.resize(set.keypoints.size());
  return std::make_shared<const FrameFeatures>(testing::kitti_camera(), std::move(set),
                                               std::move(u_right), std::vector<kys::Prior>{});
}

Map empty_map() {
  return {testing::kitti_camera(), ScaleLevels(1.2, 8)};
}

void add_keyframe(Map& map, std::uint32_t id, int octave = 2, float disparity = 30,
                  int features = 100) {
  map.add_keyframe(make_keyframe(id, plain_features(features, octave, disparity)));
  if (id > 0) map.connect_to_spanning_tree(kf(id), kf(id - 1));
}

class LandmarkCulling : public ::testing::Test {
 protected:
  /// A landmark made by keyframe 0 and seen by keyframes 0 to n-1.
  void add(std::uint32_t id, std::uint32_t n, std::uint32_t visible = 1, std::uint32_t found = 1) {
    map_.add_landmark(make_landmark(id, {0, 0, 10}));
    for (std::uint32_t k = 0; k < n; ++k) map_.add_observation(lm(id), kf(k), id);
    map_.refresh_landmark(lm(id));
    map_.add_visible(lm(id), visible - 1, found - 1);
    recent_.add(lm(id));
  }
  int cull(std::uint32_t current) { return recent_.cull(map_, kf(current), {}); }

  Map map_ = empty_map();
  RecentLandmarks recent_;
};

TEST_F(LandmarkCulling, ALandmarkThatIsRarelyFoundGoes) {
  add_keyframe(map_, 0);
  add_keyframe(map_, 1);
  add(0, 2, 8, 2);  // a quarter: enough
  add(1, 2, 9, 2);  // less
  EXPECT_EQ(cull(0), 1);
  EXPECT_TRUE(map_.has(lm(0)));
  EXPECT_FALSE(map_.has(lm(1)));
}

TEST_F(LandmarkCulling, TwoKeyframesLaterTwoStereoViewsAreNeeded) {
  add_keyframe(map_, 0);
  add_keyframe(map_, 1);
  add(0, 1);
  add(1, 2);
  EXPECT_EQ(cull(0), 0);
  EXPECT_EQ(cull(1), 0) << "one keyframe later it is too early to say";
  EXPECT_EQ(cull(2), 1);
  EXPECT_FALSE(map_.has(lm(0)));
  EXPECT_TRUE(map_.has(lm(1)));
}

TEST_F(LandmarkCulling, MonocularViewsCountHalf) {
  for (std::uint32_t k = 0; k < 4; ++k) add_keyframe(map_, k, 2, 0);
  add(0, 3);
  add(1, 4);
  EXPECT_EQ(cull(2), 1);
  EXPECT_FALSE(map_.has(lm(0))) << "three monocular views weigh three";
  EXPECT_TRUE(map_.has(lm(1)));
}

TEST_F(LandmarkCulling, ThreeKeyframesLaterItHasPassed) {
  add_keyframe(map_, 0);
  add_keyframe(map_, 1);
  add(0, 2);
  EXPECT_EQ(cull(3), 0);
  map_.add_visible(lm(0), 1000, 0);
  EXPECT_EQ(cull(4), 0) << "nobody asks any more";
  EXPECT_TRUE(map_.has(lm(0)));
}

TEST_F(LandmarkCulling, LandmarksGoneOtherwiseAreForgotten) {
  add_keyframe(map_, 0);
  add_keyframe(map_, 1);
  add(0, 2);
  map_.erase_landmark(lm(0));
  EXPECT_EQ(cull(1), 0);
  map_.check_consistency();
}

class KeyFrameCulling : public ::testing::Test {
 protected:
  /// Landmarks `first` to `first + count - 1` at the features of the same number of these.
  void share(std::uint32_t first, std::uint32_t count, std::initializer_list<std::uint32_t> by) {
    for (std::uint32_t i = first; i < first + count; ++i) {
      map_.add_landmark(make_landmark(i, {0, 0, 10}));
      for (const std::uint32_t k : by) map_.add_observation(lm(i), kf(k), i);
      map_.refresh_landmark(lm(i));
    }
  }
  void connect() {
    for (std::uint32_t k = 1; k < 5; ++k) map_.connect_to_spanning_tree(kf(k), kf(k - 1));
    map_.check_consistency();
  }
  int cull(const KeyFrameCullingOptions& options = {}) {
    const int n = cull_keyframes(map_, kf(4), options);
    map_.check_consistency();
    return n;
  }

  Map map_ = empty_map();
};

TEST_F(KeyFrameCulling, OneWhoseLandmarksThreeOthersSeeGoes) {
  for (std::uint32_t k = 0; k < 5; ++k) add_keyframe(map_, k);
  share(0, 46, {0, 2, 3, 4});
  share(46, 4, {3, 4});
  // Keyframe 2: 46 of 46; keyframe 3: 46 of 50 while 2 is there.
  connect();
  EXPECT_EQ(cull(), 1);
  EXPECT_FALSE(map_.has(kf(2)) && map_.has(kf(3))) << "one of them is enough";
  EXPECT_TRUE(map_.has(kf(0))) << "the root stays";
  EXPECT_TRUE(map_.has(kf(4))) << "and so does the current one";
}

TEST_F(KeyFrameCulling, NinetyPercentAreNotMoreThanNinetyPercent) {
  for (std::uint32_t k = 0; k < 5; ++k) add_keyframe(map_, k);
  share(0, 45, {0, 1, 2, 4});
  share(45, 5, {1, 4});
  share(50, 5, {2, 4});
  connect();
  EXPECT_EQ(cull(), 0) << "45 of 50 in both";
  KeyFrameCullingOptions options;
  options.redundant_share = 0.89;
  EXPECT_EQ(cull(options), 1);
}

TEST_F(KeyFrameCulling, CoarserViewsDoNotReplaceFinerOnes) {
  for (std::uint32_t k = 0; k < 5; ++k) add_keyframe(map_, k, k == 2 ? 0 : 2);
  share(0, 50, {0, 2, 3, 4});
  connect();
  // Seen on octave 2 elsewhere, more than one above that of keyframe 2; keyframe 3 is replaceable.
  EXPECT_EQ(cull(), 1);
  EXPECT_TRUE(map_.has(kf(2)));
  EXPECT_FALSE(map_.has(kf(3)));
}

TEST_F(KeyFrameCulling, FarLandmarksDoNotCount) {
  // 5 px: 77 m, more than 40 baselines of 0.54 m.
  for (std::uint32_t k = 0; k < 5; ++k) add_keyframe(map_, k, 2, 5);
  share(0, 50, {0, 2, 3, 4});
  connect();
  EXPECT_EQ(cull(), 0) << "there are no close landmarks to judge by";
  KeyFrameCullingOptions options;
  options.close_baselines = 200;
  EXPECT_EQ(cull(options), 1);
}

TEST_F(KeyFrameCulling, TwoOtherObserversAreNotEnough) {
  for (std::uint32_t k = 0; k < 5; ++k) add_keyframe(map_, k);
  share(0, 50, {2, 3, 4});
  connect();
  EXPECT_EQ(cull(), 0);
}

}  // namespace
}  // namespace kys_slam
