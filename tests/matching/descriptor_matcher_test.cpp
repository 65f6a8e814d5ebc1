// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_matcher.h"

#include <gtest/gtest.h>

#include "descriptor_bits.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::bits;
using testing::frame_of;

class DescriptorMatcher : public ::testing::Test {
 protected:
  std::vector<std::int32_t> match(const std::vector<DescriptorQuery>& queries,
                                  const FrameFeatures& features,
                                  const DescriptorMatchOptions& options = {}) {
    return match_descriptors(queries, features, options, model_, statistics_);
  }
  kys::DistanceModel model_;
  kys::Statistics statistics_;
  kys::Prior prior_;
  kys::Descriptor zero_;
};

TEST_F(DescriptorMatcher, FindsEveryPointOfAWorldSeenFromTwoPlaces) {
  testing::FeatureWorld::Options options;
  options.flipped_bits = 12;
  const testing::FeatureWorld world(testing::kitti_camera(), options);
  const auto a = testing::see(world, 0, testing::weaving_pose(0));
  const auto b = testing::see(world, 1, testing::weaving_pose(1.5));
  std::vector<DescriptorQuery> queries;
  for (std::size_t i = 0; i < a.features->size(); ++i) {
    queries.push_back({&a.features->descriptor(i), &prior_, a.features->keypoint(i).angle});
  }
  const auto matches = match(queries, *b.features);
  int common = 0;
  int right = 0;
  int wrong = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    common += std::count(b.points.begin(), b.points.end(), a.points[i]) > 0 ? 1 : 0;
    if (matches[i] < 0) continue;
    ++(b.points[static_cast<std::size_t>(matches[i])] == a.points[i] ? right : wrong);
  }
  EXPECT_GT(common, 300);
  EXPECT_EQ(wrong, 0) << "random descriptors of 256 bits are not mistaken";
  EXPECT_GT(right, 0.98 * common);
}

TEST_F(DescriptorMatcher, RatioAndLargestDistance) {
  DescriptorMatchOptions options;
  options.check_rotation = false;
  const StereoCamera camera = testing::kitti_camera();
  const auto pair = [&](int best, int second) {
    const auto features =
        frame_of(camera, {{10, 10, 0, bits(second, 100)}, {900, 300, 5, bits(best)}});
    return match({{&zero_, &prior_, 0}}, features, options)[0];
  };
  EXPECT_EQ(pair(20, 29), 1) << "20 < 0.7 * 29";
  EXPECT_EQ(pair(20, 28), -1) << "20 > 0.7 * 28";
  EXPECT_EQ(pair(50, 120), 1);
  EXPECT_EQ(pair(51, 120), -1);
}

TEST_F(DescriptorMatcher, AFeatureIsUsedOnceByTheNearest) {
  DescriptorMatchOptions options;
  options.check_rotation = false;
  const kys::Descriptor near = bits(3);
  const kys::Descriptor far = bits(7, 60);
  const auto features = frame_of(testing::kitti_camera(), {{10, 10, 0, zero_}});
  EXPECT_EQ(match({{&far, &prior_, 0}, {&near, &prior_, 0}}, features, options),
            (std::vector<std::int32_t>{-1, 0}));
  EXPECT_EQ(match({{&near, &prior_, 0}, {&far, &prior_, 0}}, features, options),
            (std::vector<std::int32_t>{0, -1}));
}

TEST_F(DescriptorMatcher, AnUnusualTurnIsCut) {
  std::vector<testing::HandMade> features;
  std::vector<kys::Descriptor> descriptors;
  std::mt19937_64 random(2);
  for (int i = 0; i < 30; ++i) {
    kys::Descriptor d;
    for (auto& word : d.words) word = random();
    descriptors.push_back(d);
    features.push_back({20.0f * static_cast<float>(i), 100, 0, d, testing::kNoStereo, 0.5f});
  }
  std::vector<DescriptorQuery> queries;
  for (std::size_t i = 0; i < 30; ++i) {
    queries.push_back({&descriptors[i], &prior_, i == 4 ? 4.0f : 0.7f});
  }
  const auto frame = frame_of(testing::kitti_camera(), features);
  const auto matches = match(queries, frame);
  for (int i = 0; i < 30; ++i) {
    EXPECT_EQ(matches[static_cast<std::size_t>(i)], i == 4 ? -1 : i);
  }
}

}  // namespace
}  // namespace kys_slam
