// SPDX-License-Identifier: BSD-3-Clause
#include "matching/row_alignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "features/pyramid.h"

namespace kys_slam {
namespace {

constexpr int kRowsWidth = 320, kRowsHeight = 200;

double corners(double x, double y) {
  return 128 + 40 * std::sin(0.45 * x + 0.2 * y) + 40 * std::sin(0.5 * y - 0.13 * x + 1) +
         20 * std::sin(0.31 * x + 0.37 * y + 2);
}

template <typename Grey>
ImagePyramid pyramid_of(Grey&& grey) {
  GrayImage image(kRowsWidth, kRowsHeight);
  for (int y = 0; y < kRowsHeight; ++y) {
    for (int x = 0; x < kRowsWidth; ++x) {
      image.row(y)[x] = static_cast<std::uint8_t>(std::lround(grey(x, y)));
    }
  }
  ImagePyramid pyramid;
  PyramidBuilder().build(image, 1.2, 8, pyramid);
  return pyramid;
}

FeatureSet grid_of_keypoints() {
  FeatureSet set;
  for (int y = 40; y < kRowsHeight - 40; y += 12) {
    for (int x = 60; x < kRowsWidth - 40; x += 12) {
      Keypoint k;
      k.x = static_cast<float>(x) + 0.3f;
      k.y = static_cast<float>(y) + 0.6f;
      k.octave = static_cast<std::uint8_t>((x / 12) % 3);
      set.keypoints.push_back(k);
    }
  }
  set.descriptors.resize(set.size());
  return set;
}

TEST(RowAlignment, FindsRowsThatDifferFromPlaceToPlace) {
  // 5 px of disparity; rows lower by 0.8 px at the left and higher by 0.8 px at the right.
  const auto lower = [](double x) { return 0.8 - 1.6 * x / kRowsWidth; };
  const ImagePyramid left = pyramid_of(corners);
  const ImagePyramid right =
      pyramid_of([&](double x, double y) { return corners(x + 5, y - lower(x)); });
  const FeatureSet features = grid_of_keypoints();
  std::vector<float> u_right;
  for (const Keypoint& k : features.keypoints) u_right.push_back(k.x - 5.4f);
  const std::vector<float> rows =
      measure_rows({&features, {}, &left}, {nullptr, {}, &right}, u_right, {}, 10000);
  int measured = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (std::isnan(rows[i])) continue;
    ++measured;
    const Keypoint& k = features.keypoints[i];
    EXPECT_NEAR(rows[i] - k.y, lower(k.x - 5), 0.06) << k.x << ", " << k.y;
  }
  EXPECT_GT(measured, static_cast<int>(rows.size()) * 3 / 4);
}

TEST(RowAlignment, AnEdgeAloneTellsNoRow) {
  const auto edges = [](double x, double) { return 128 + 80 * std::sin(0.5 * x); };
  const ImagePyramid left = pyramid_of(edges);
  const FeatureSet features = grid_of_keypoints();
  std::vector<float> u_right;
  for (const Keypoint& k : features.keypoints) u_right.push_back(k.x);
  for (const float row :
       measure_rows({&features, {}, &left}, {nullptr, {}, &left}, u_right, {}, 10000)) {
    EXPECT_TRUE(std::isnan(row));
  }
}

TEST(RowAlignment, MeasuresNoMoreThanAsked) {
  const ImagePyramid left = pyramid_of(corners);
  const FeatureSet features = grid_of_keypoints();
  std::vector<float> u_right;
  for (const Keypoint& k : features.keypoints) u_right.push_back(k.x);
  u_right[7] = std::nanf("");
  const auto rows = measure_rows({&features, {}, &left}, {nullptr, {}, &left}, u_right, {}, 40);
  const auto count =
      std::count_if(rows.begin(), rows.end(), [](float row) { return !std::isnan(row); });
  EXPECT_LE(count, 40);
  EXPECT_GT(count, 25);
  EXPECT_TRUE(std::isnan(rows[7]));
}

}  // namespace
}  // namespace kys_slam
