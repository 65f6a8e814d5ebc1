// Keypoints on regions of the image that need few, and on the rest.

#include "features/sparse_regions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "features/orb_extractor.h"
#include "synthetic_images.h"

namespace kys_slam {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 240;
constexpr int kStep = 4;

/// Regions 0 and 1: the columns [0, 200) and [200, 400).
SparseRegions two_regions() {
  SparseRegions sparse{kStep, kWidth / kStep, {}};
  for (int y = 0; y < kHeight; y += kStep) {
    for (int x = 0; x < kWidth; x += kStep) {
      sparse.region.push_back(x < 200 ? 0 : x < 400 ? 1 : -1);
    }
  }
  return sparse;
}

/// Rich texture; from column 400 on its contrast is a part of that.
GrayImage image(double contrast) {
  GrayImage result = test::Texture(4).render(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 400; x < kWidth; ++x) {
      result.row(y)[x] = static_cast<std::uint8_t>(100 + contrast * (result.row(y)[x] - 100));
    }
  }
  return result;
}

FeatureSet extract(const GrayImage& from, const OrbOptions& options,
                   const SparseRegions& sparse = {}) {
  FeatureSet features;
  OrbExtractor(options).extract(from, features, sparse);
  return features;
}

std::vector<Keypoint> keypoints_of(const FeatureSet& features, std::int32_t region) {
  const SparseRegions sparse = two_regions();
  std::vector<Keypoint> chosen;
  for (const Keypoint& k : features.keypoints) {
    const auto x = static_cast<int>(k.x + 0.5f);
    if (sparse.at(x, static_cast<int>(k.y + 0.5f)) == region) chosen.push_back(k);
  }
  return chosen;
}

TEST(SparseRegions, KnowPixelsAndTheirEdges) {
  const SparseRegions sparse = two_regions();
  EXPECT_EQ(sparse.at(199, 0), 0);
  EXPECT_EQ(sparse.at(200, 239), 1);
  EXPECT_EQ(sparse.at(400, 100), -1);
  EXPECT_EQ(sparse.at(-1, 100), -1);
  EXPECT_EQ(sparse.at(10, 240), -1);
  EXPECT_TRUE(sparse.is_interior(191, 100, 2));
  EXPECT_FALSE(sparse.is_interior(192, 100, 2)) << "two cells away is region 1";
  EXPECT_FALSE(sparse.is_interior(100, 7, 2)) << "the image ends";
}

TEST(SparseRegions, HaveFewKeypointsEachAndTheRestKeepsItsOwn) {
  OrbOptions options;
  options.moving_keypoints = 40;
  options.static_share = 0;
  const GrayImage from = image(1);
  const FeatureSet all = extract(from, options);
  const FeatureSet thinned = extract(from, options, two_regions());
  ASSERT_GT(keypoints_of(all, 0).size(), 200u);
  ASSERT_GT(keypoints_of(all, 1).size(), 200u);
  // Sub-pixel parts move a few over the edge.
  EXPECT_NEAR(static_cast<double>(keypoints_of(thinned, 0).size()), 40, 2);
  EXPECT_NEAR(static_cast<double>(keypoints_of(thinned, 1).size()), 40, 2);
  const auto beyond_the_edge = [](std::vector<Keypoint> keypoints) {
    std::erase_if(keypoints, [](const Keypoint& k) { return k.x < 402; });
    return keypoints;
  };
  EXPECT_TRUE(beyond_the_edge(keypoints_of(thinned, -1)) == beyond_the_edge(keypoints_of(all, -1)));
}

TEST(SparseRegions, KeepKeypointsInsideThemOfLargestAngle) {
  OrbOptions options;
  options.moving_keypoints = 40;
  const GrayImage from = image(1);
  float least = 10;
  for (const Keypoint& k : keypoints_of(extract(from, options, two_regions()), 0)) {
    EXPECT_LT(k.x, 193) << "not at the edge";
    least = std::min(least, k.angle);
  }
  std::size_t larger = 0;
  for (const Keypoint& k : keypoints_of(extract(from, options), 0)) {
    const bool inside = k.x < 191.5f && k.y > 8.5f && k.y < kHeight - 8.5f && k.x > 8.5f;
    larger += inside && k.angle > least ? 1 : 0;
  }
  EXPECT_EQ(larger, 39u);
}

TEST(SparseRegions, TheRestIsFilledUpWithWeakCorners) {
  OrbOptions options;
  options.fast_threshold = 20;
  const GrayImage from = image(0.3);
  const std::size_t before = keypoints_of(extract(from, options), -1).size();
  const std::size_t after = keypoints_of(extract(from, options, two_regions()), -1).size();
  ASSERT_LT(before, 700u);
  EXPECT_GE(after, 900u) << "about half of 2000";
  EXPECT_LE(after, 1040u);
}

TEST(SparseRegions, LevelsAndNumbersStayInOrder) {
  const FeatureSet features = extract(image(0.3), {}, two_regions());
  EXPECT_TRUE(
      std::is_sorted(features.keypoints.begin(), features.keypoints.end(),
                     [](const Keypoint& a, const Keypoint& b) { return a.octave < b.octave; }));
  EXPECT_EQ(features.keypoints.size(), features.descriptors.size());
}

}  // namespace
}  // namespace kys_slam
