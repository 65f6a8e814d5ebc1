// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/sparsification.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::make_keyframe;
using testing::make_landmark;
using testing::random_features;

constexpr std::uint32_t kInView = 30;  // landmarks of a keyframe, of which `kNewOnes` are new
constexpr std::uint32_t kNewOnes = 10;

/// Keyframes along a line: number k sees landmarks 10 k to 10 k + 29, so that it shares 20 of its
/// 30 with the next one, 10 with the one after that, and none with others.
class SparsificationOfKeyframes : public ::testing::Test {
 protected:
  void add_keyframes(int count) {
    for (int n = 0; n < count; ++n) {
      const std::uint32_t id = map_.keyframe_id_end();
      map_.add_keyframe(make_keyframe(id, random_features(map_.camera(), kInView, id + 1, 1.0)));
      for (std::uint32_t i = 0; i < kInView; ++i) {
        const LandmarkId landmark{kNewOnes * id + i};
        if (!map_.has(landmark)) map_.add_landmark(make_landmark(landmark.value, {0, 0, 10}));
        map_.add_observation(landmark, {id}, i);
        map_.refresh_landmark(landmark);
      }
      if (id > 0) map_.connect_to_spanning_tree({id}, {id - 1});
      sparsification_.add({id});
    }
  }
  int update(const std::vector<KeyFrameId>& window) {
    const int culled = sparsification_.update(map_, window);
    map_.check_consistency();
    return culled;
  }

  Map map_{testing::kitti_camera(), ScaleLevels(1.2, 8)};
  Sparsification sparsification_{SparsificationOptions{.overlap = 0.3}};
};

TEST_F(SparsificationOfKeyframes, OneWhoseNeighboursShareEnoughGoesWhenItLeavesTheWindow) {
  add_keyframes(4);
  EXPECT_EQ(update({{0}, {1}, {2}, {3}}), 0);
  EXPECT_EQ(update({{2}, {3}}), 1) << "0 and 2 share 10 of the 30 landmarks of 1";
  EXPECT_FALSE(map_.has(KeyFrameId{1}));
  EXPECT_TRUE(map_.has(KeyFrameId{0})) << "nothing is before it";
}

TEST_F(SparsificationOfKeyframes, WhatIsKeptOverlapsByTheShareThatIsStated) {
  add_keyframes(9);
  // 1 goes; then 0 and 3 share nothing, so that 2 stays, and so on.
  EXPECT_EQ(update({{8}}), 4);
  for (std::uint32_t k = 0; k < 9; ++k) EXPECT_EQ(map_.has(KeyFrameId{k}), k % 2 == 0) << k;
}

TEST_F(SparsificationOfKeyframes, AThirdIsNotMoreThanAThird) {
  sparsification_ = Sparsification(SparsificationOptions{.overlap = 10.0 / 30.0});
  add_keyframes(9);
  EXPECT_EQ(update({{8}}), 0);
}

TEST_F(SparsificationOfKeyframes, NoneIsJudgedTwice) {
  sparsification_ = Sparsification(SparsificationOptions{.overlap = 0.5});
  add_keyframes(3);
  EXPECT_EQ(update({{2}}), 0) << "10 of 30";
  for (std::uint32_t i = 0; i < 8; ++i) {  // 0 and 2 now share 18
    map_.add_observation({kNewOnes * 2 + 10 + i}, {0}, i);
  }
  map_.check_consistency();
  EXPECT_EQ(update({{2}}), 0);
}

TEST_F(SparsificationOfKeyframes, WithoutAWindowTheNewestStays) {
  add_keyframes(9);
  EXPECT_EQ(update({}), 4);
  EXPECT_TRUE(map_.has(KeyFrameId{8})) << "nothing is after it";
}

TEST_F(SparsificationOfKeyframes, AShareOfOneIsNever) {
  sparsification_ = Sparsification(SparsificationOptions{.overlap = 1});
  add_keyframes(9);
  EXPECT_EQ(update({}), 0);
}

}  // namespace
}  // namespace kys_slam
