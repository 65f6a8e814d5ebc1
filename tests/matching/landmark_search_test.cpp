// SPDX-License-Identifier: BSD-3-Clause
#include "matching/landmark_search.h"

#include <gtest/gtest.h>

#include <numbers>

#include "descriptor_bits.h"
#include "support/feature_world.h"

namespace kys_slam {
namespace {

using testing::bits;
using testing::frame_of;
using testing::HandMade;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

class LandmarkSearch : public ::testing::Test {
 protected:
  SearchQuery query(float u, float v, const kys::Descriptor& descriptor, float u_right = kNone) {
    SearchQuery q;
    q.u = u;
    q.v = v;
    q.u_right = u_right;
    q.radius = 10;
    q.min_octave = 0;
    q.max_octave = 7;
    q.descriptor = &descriptor;
    q.prior = &prior_;
    return q;
  }
  std::vector<SearchMatch> search(const std::vector<HandMade>& features,
                                  const std::vector<SearchQuery>& queries,
                                  const SearchOptions& options = {}) {
    return search_features(frame_of(testing::kitti_camera(), features), scales_, queries, options,
                           model_, statistics_);
  }

  ScaleLevels scales_{1.2, 8};
  kys::DistanceModel model_;
  kys::Prior prior_;
  kys::Statistics statistics_;
  kys::Descriptor zero_;
};

TEST_F(LandmarkSearch, TakesTheNearestDescriptorInTheSquare) {
  const auto matches = search({{100, 100, 0, bits(20)},
                               {105, 95, 0, bits(12)},
                               {111, 100, 0, bits(0)},  // 11 px away
                               {100, 89, 0, bits(0)}},  // 11 px away
                              {query(100, 100, zero_)});
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].feature, 1);
  EXPECT_FLOAT_EQ(matches[0].distance, 12);
  EXPECT_EQ(statistics_.total(), 2u) << "every compared pair is counted once";
  EXPECT_EQ(statistics_.accepted_of(kys::Tier::kBypassed), 1u);
}

TEST_F(LandmarkSearch, KeepsToOctavesAndToTheLargestDistance) {
  SearchQuery q = query(100, 100, zero_);
  q.min_octave = 2;
  q.max_octave = 3;
  const std::vector<HandMade> features{
      {100, 100, 1, bits(1)}, {100, 100, 3, bits(40)}, {100, 100, 4, bits(1)}};
  EXPECT_EQ(search(features, {q})[0].feature, 1);
  SearchOptions strict;
  strict.max_distance = 39;
  EXPECT_EQ(search(features, {q}, strict)[0].feature, -1);
  strict.max_distance = 40;
  EXPECT_EQ(search(features, {q}, strict)[0].feature, 1) << "the bound itself is accepted";
}

TEST_F(LandmarkSearch, RatioTestComparesWithinOneOctave) {
  SearchOptions options;
  options.ratio = 0.8f;
  EXPECT_EQ(search({{100, 100, 2, bits(20)}, {101, 100, 2, bits(24)}}, {query(100, 100, zero_)},
                   options)[0]
                .feature,
            -1)
      << "20 > 0.8 * 24";
  EXPECT_EQ(search({{100, 100, 2, bits(20)}, {101, 100, 2, bits(26)}}, {query(100, 100, zero_)},
                   options)[0]
                .feature,
            0);
  EXPECT_EQ(search({{101, 100, 2, bits(24)}, {100, 100, 2, bits(20)}}, {query(100, 100, zero_)},
                   options)[0]
                .feature,
            -1)
      << "whatever the order";
  EXPECT_EQ(search({{100, 100, 2, bits(20)}, {101, 100, 3, bits(21)}}, {query(100, 100, zero_)},
                   options)[0]
                .feature,
            0)
      << "the same corner on two octaves is no ambiguity";
  EXPECT_EQ(
      search({{100, 100, 2, bits(20)}, {101, 100, 2, bits(20, 100)}}, {query(100, 100, zero_)})[0]
          .feature,
      0)
      << "not tested unless asked for";
}

TEST_F(LandmarkSearch, LeavesTakenFeaturesAlone) {
  const std::vector<std::uint8_t> taken{1, 0};
  SearchOptions options;
  options.taken = taken;
  const auto matches =
      search({{100, 100, 0, bits(0)}, {100, 100, 0, bits(30)}}, {query(100, 100, zero_)}, options);
  EXPECT_EQ(matches[0].feature, 1);
}

TEST_F(LandmarkSearch, AFeatureGoesToTheNearestOfThoseThatChoseIt) {
  const kys::Descriptor five = bits(5);
  const kys::Descriptor other = bits(9, 100);
  const std::vector<HandMade> features{{100, 100, 0, zero_}};
  auto matches = search(features, {query(100, 100, other), query(101, 100, five)});
  EXPECT_EQ(matches[0].feature, -1) << "nine bits away: lost to the second";
  EXPECT_EQ(matches[1].feature, 0);
  matches = search(features, {query(100, 100, five), query(101, 100, other)});
  EXPECT_EQ(matches[0].feature, 0);
  EXPECT_EQ(matches[1].feature, -1);
  matches = search(features, {query(100, 100, five), query(101, 100, five)});
  EXPECT_EQ(matches[0].feature, 0) << "of equals the first";
  EXPECT_EQ(matches[1].feature, -1);
}

TEST_F(LandmarkSearch, ComparesTheRightColumnWhereThereIsOne) {
  const std::vector<HandMade> features{{100, 100, 0, bits(1), 80}, {100, 100, 0, bits(9)}};
  EXPECT_EQ(search(features, {query(100, 100, zero_, 89)})[0].feature, 0) << "9 px off: within 10";
  EXPECT_EQ(search(features, {query(100, 100, zero_, 91)})[0].feature, 1)
      << "11 px off; the other has no right column to compare";
  EXPECT_EQ(search(features, {query(100, 100, zero_)})[0].feature, 0) << "no prediction: open";
}

TEST_F(LandmarkSearch, ErrorBoundsAreThoseOfChiSquare) {
  SearchOptions options;
  options.check_error = true;
  // In standard deviations at octave 0: of u, and of the disparity.
  const auto found = [&](float du, float dd, int octave, bool stereo) {
    HandMade f{100 + kPixelSigma * du, 100, octave, zero_};
    if (stereo) f.u_right = f.x - 20 - kPixelSigma * dd;
    return search({f}, {query(100, 100, zero_, 80)}, options)[0].feature == 0;
  };
  // Left image alone: 5.991, i.e. 2.447 deviations; with the right one 7.815, 2.795.
  EXPECT_TRUE(found(2.44f, 0, 0, false));
  EXPECT_FALSE(found(2.46f, 0, 0, false));
  EXPECT_TRUE(found(2.79f, 0, 0, true));
  EXPECT_FALSE(found(2.81f, 0, 0, true));
  EXPECT_FALSE(found(2.1f, 2.1f, 0, true));
  EXPECT_TRUE(found(1.9f, 1.9f, 0, true));
  EXPECT_TRUE(found(1.9f, -1.9f, 0, true)) << "the disparity's error has nothing to do with u's";
  // One octave up everything is 1.2 times as far.
  EXPECT_TRUE(found(2.93f, 0, 1, false));
  EXPECT_FALSE(found(2.95f, 0, 1, false));
}

TEST_F(LandmarkSearch, TurnsThatDifferFromTheOthersAreCut) {
  std::vector<HandMade> features;
  std::vector<SearchQuery> queries;
  for (int i = 0; i < 40; ++i) {
    HandMade f{30.0f * static_cast<float>(i) + 20, 100, 0, zero_};
    f.angle = 1;
    features.push_back(f);
    SearchQuery q = query(f.x, f.y, zero_);
    q.angle = i == 7 ? 3.5f : 1.05f;
    queries.push_back(q);
  }
  SearchOptions options;
  EXPECT_EQ(search(features, queries, options)[7].feature, 7);
  options.check_rotation = true;
  const auto matches = search(features, queries, options);
  for (int i = 0; i < 40; ++i) {
    EXPECT_EQ(matches[static_cast<std::size_t>(i)].feature, i == 7 ? -1 : i);
  }
}

TEST_F(LandmarkSearch, EmptyFramesAndEmptyQueriesGiveNothing) {
  EXPECT_TRUE(search({}, {}).empty());
  EXPECT_EQ(search({}, {query(5, 5, zero_)})[0].feature, -1);
  SearchOptions options;
  options.check_rotation = true;
  EXPECT_EQ(search({}, {query(5, 5, zero_)}, options)[0].feature, -1);
}

TEST(ConsistentRotations, KeepsTheThreeFullestBins) {
  constexpr float kBin = 2 * std::numbers::pi_v<float> / 30;
  std::vector<float> turns;
  const auto add = [&](int bin, int count) { turns.insert(turns.end(), count, kBin * bin); };
  add(3, 20);
  add(10, 10);
  add(17, 5);
  add(25, 4);
  const auto kept = consistent_rotations(turns);
  for (std::size_t i = 0; i < turns.size(); ++i) EXPECT_EQ(kept[i], i < 35 ? 1 : 0) << i;
}

TEST(ConsistentRotations, BinsOfLessThanATenthOfTheFullestGo) {
  constexpr float kBin = 2 * std::numbers::pi_v<float> / 30;
  std::vector<float> turns(50, 0.0f);
  turns.insert(turns.end(), 4, 10 * kBin);
  auto kept = consistent_rotations(turns);
  EXPECT_EQ(kept[0], 1);
  EXPECT_EQ(kept[50], 0) << "4 of 50";
  turns.push_back(10 * kBin);
  kept = consistent_rotations(turns);
  EXPECT_EQ(kept[50], 1) << "5 of 50";
}

TEST(ConsistentRotations, AFullTurnIsNoTurn) {
  constexpr float kTurn = 2 * std::numbers::pi_v<float>;
  const std::vector<float> turns{0.01f, -0.01f, kTurn - 0.01f, -kTurn + 0.01f, 3 * kTurn};
  for (const std::uint8_t kept : consistent_rotations(turns)) EXPECT_EQ(kept, 1);
  EXPECT_TRUE(consistent_rotations({}).empty());
}

}  // namespace
}  // namespace kys_slam
