// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/thinning.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::make_keyframe;
using testing::make_landmark;
using testing::random_features;

constexpr std::size_t kFeatures = 60;

/// Keyframes one after the other, each seeing the ten landmarks of the one before and ten new ones;
/// with `old` also landmark 0.
class ThinningOfKeyframes : public ::testing::Test {
 protected:
  void add_keyframe(Thinning& thinning, bool old = false) {
    const std::uint32_t id = map_.keyframe_id_end();
    map_.add_keyframe(make_keyframe(id, random_features(map_.camera(), kFeatures, id + 1, 1.0)));
    for (std::uint32_t i = 0; i < 10; ++i) {
      const LandmarkId made{10 * id + i};
      map_.add_landmark(make_landmark(made.value, {0, 0, 10}));
      map_.add_observation(made, {id}, 2 * i);
      map_.refresh_landmark(made);
      if (id > 0) map_.add_observation({made.value - 10}, {id}, 2 * i + 1);
    }
    if (old) map_.add_observation({0}, {id}, 40);
    if (id > 0) map_.connect_to_spanning_tree({id}, {id - 1});
    thinned_ += thinning.update(map_, {id});
    map_.check_consistency();
  }
  [[nodiscard]] std::size_t features(std::uint32_t id) const {
    return map_.keyframe({id}).features->size();
  }

  Map map_{testing::kitti_camera(), ScaleLevels(1.2, 8)};
  int thinned_ = 0;
};

TEST_F(ThinningOfKeyframes, WaitsForItsPatienceAfterTheLastSharedLandmark) {
  Thinning thinning({5});
  for (int k = 0; k < 6; ++k) add_keyframe(thinning);
  EXPECT_EQ(thinned_, 0) << "keyframe 0 was last covisible with 1, and 1 with 2";
  EXPECT_EQ(features(0), kFeatures);
  add_keyframe(thinning);
  EXPECT_EQ(thinned_, 1);
  EXPECT_EQ(features(0), 10u) << "those that see a landmark";
}

TEST_F(ThinningOfKeyframes, AKeyframeInUseStaysWhole) {
  Thinning thinning({3});
  for (int k = 0; k < 12; ++k) add_keyframe(thinning, k >= 4 && k % 3 == 1);
  EXPECT_EQ(features(0), kFeatures) << "every third keyframe sees a landmark of it";
  EXPECT_EQ(features(5), 20u) << "nothing did after the next";
}

TEST_F(ThinningOfKeyframes, ZeroMeansNever) {
  Thinning thinning({0});
  for (int k = 0; k < 20; ++k) add_keyframe(thinning);
  EXPECT_EQ(thinned_, 0);
}

TEST_F(ThinningOfKeyframes, KeyframesOfALoadedMapCountFromTheFirstNewOne) {
  Thinning before({0});
  for (int k = 0; k < 10; ++k) add_keyframe(before);
  Thinning thinning({4});
  thinning.continue_map(map_);
  for (int k = 0; k < 4; ++k) add_keyframe(thinning);
  EXPECT_EQ(thinned_, 0);
  add_keyframe(thinning);
  EXPECT_EQ(thinned_, 10);
}

}  // namespace
}  // namespace kys_slam
