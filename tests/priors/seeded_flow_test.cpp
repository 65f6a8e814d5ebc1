// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/seeded_flow.h"

#include <gtest/gtest.h>
#include <kys_slam/util/median.h>

#include <cmath>
#include <tuple>
#include <vector>

#include "synthetic_scene.h"

namespace kys_slam {
namespace {

ImageOf<float> row_of(const std::vector<float>& values) {
  ImageOf<float> image(static_cast<int>(values.size()), 1);
  std::copy(values.begin(), values.end(), image.data());
  return image;
}

TEST(SeededFlow, GapsOfDisparityAreFilledByTheFartherSide) {
  const float no = kNoValue;
  const ImageOf<float> filled = fill_disparity(row_of({no, 5, no, no, 3, no, 4, no}), 0.5F);
  const std::vector<float> expected = {5, 5, 3, 3, 3, 3, 4, 4};
  for (int x = 0; x < 8; ++x) EXPECT_EQ(filled.at(x, 0), expected[static_cast<std::size_t>(x)]);
  EXPECT_EQ(fill_disparity(row_of({no, no}), 0.5F).at(1, 0), 0.5F);
}

TEST(SeededFlow, TheFlowBackComesFromTheNearestOfThoseThatEndThere) {
  // Far pixels go 1 to the right, the near one at 2 goes 3 to the right, where the far one of 4
  // ends; nothing ends at 0 and at 3.
  const FlowField forward{row_of({1, 1, 3, 1, 1, 1}), row_of({0, 0, 0, 0, 0, 0})};
  const FlowField back = reverse_flow(forward, row_of({1, 1, 9, 1, 1, 1}));
  const std::vector<float> expected = {-1, -1, -1, -1, -1, -3};
  for (int x = 0; x < 6; ++x) EXPECT_EQ(back.u.at(x, 0), expected[static_cast<std::size_t>(x)]);
}

/// Random grey levels every 4 px, linear between.
GrayImage texture(int width, int height) {
  constexpr int kStep = 4;
  const int columns = width / kStep + 2;
  std::vector<double> grid(static_cast<std::size_t>(columns * (height / kStep + 2)));
  std::uint32_t seed = 7;
  for (double& value : grid) {
    seed = seed * 1664525u + 1013904223u;
    value = static_cast<double>(seed >> 24);
  }
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double a = x % kStep / 4.0, b = y % kStep / 4.0;
      const double* at = grid.data() + y / kStep * columns + x / kStep;
      image.at(x, y) = static_cast<std::uint8_t>((1 - b) * ((1 - a) * at[0] + a * at[1]) +
                                                 b * ((1 - a) * at[columns] + a * at[columns + 1]));
    }
  }
  return image;
}

/// A wall of disparity 4 px, a pole of 14 px width (40 px) and a box (40 px) before it.
/// The camera goes aside by 0.75 baselines, static flow is -0.75 times disparity; the box moves by
/// 12 px less.
struct FlowScene {
  static constexpr int kWidth = 400, kHeight = 128;
  StereoCamera camera = synthetic::kitti_camera(kWidth, kHeight);
  GrayImage now{kWidth, kHeight}, next{kWidth, kHeight};
  ImageOf<float> disparity{kWidth, kHeight};
  ImageOf<std::uint16_t> map{kWidth, kHeight};
  std::vector<std::uint8_t> is_stuff = {0, 1, 0, 0};

  FlowScene() {
    const GrayImage noise = texture(kWidth + 100, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const auto [segment, d, grey] = look(noise, x, y, 0, 0, 0);
        map.at(x, y) = segment;
        disparity.at(x, y) = d;
        now.at(x, y) = grey;
        next.at(x, y) = std::get<2>(look(noise, x, y, 3, 30, 18));
      }
    }
  }

 private:
  /// Segment, disparity and grey level of a pixel; what is there has moved to the left by the rest.
  static std::tuple<std::uint16_t, float, std::uint8_t> look(const GrayImage& noise, int x, int y,
                                                             int wall, int pole, int box) {
    const int p = x + pole, b = x + box;
    if (b >= 260 && b < 330 && y >= 30 && y < 100) return {3, 40.0F, noise.at(b, y)};
    if (p >= 140 && p < 154 && y >= 10 && y < 120) return {2, 40.0F, noise.at(p + 50, y)};
    return {1, 4.0F, noise.at(x + wall, y)};
  }
};

/// Median of the flow's column part over a segment; 0 without any. Share of its pixels with flow.
std::pair<double, double> flow_of(const FlowScene& scene, const FlowField& flow, int segment) {
  std::vector<float> values;
  double area = 0;
  for (std::size_t i = 0; i < scene.map.size(); ++i) {
    if (scene.map.data()[i] != segment) continue;
    ++area;
    if (flow.u.data()[i] == flow.u.data()[i]) values.push_back(flow.u.data()[i]);
  }
  const double share = static_cast<double>(values.size()) / area;
  return {values.empty() ? 0.0 : static_cast<double>(median(values)), share};
}

TEST(SeededFlow, ThinThingsAreFollowedByDepthAndWhatMovesIsStillSeen) {
  const FlowScene scene;
  BuilderOptions options;
  options.ego_motion.border = 5;
  const auto estimate = [&] {
    return estimate_checked_flow(options, scene.camera, scene.now, scene.next, scene.disparity,
                                 scene.map, scene.is_stuff);
  };
  options.flow_estimate.seeded = false;
  const auto [alone, alone_seen] = flow_of(scene, estimate(), 2);
  EXPECT_TRUE(std::abs(alone + 30) > 3 || alone_seen < 0.3)
      << "thinner than its way, the search alone loses it: " << alone << " " << alone_seen;

  options.flow_estimate.seeded = true;
  const FlowField flow = estimate();
  EXPECT_NEAR(flow_of(scene, flow, 1).first, -3, 0.2);
  EXPECT_NEAR(flow_of(scene, flow, 2).first, -30, 0.3);
  EXPECT_GT(flow_of(scene, flow, 2).second, 0.6);
  EXPECT_NEAR(flow_of(scene, flow, 3).first, -18, 0.5);
  EXPECT_GT(flow_of(scene, flow, 3).second, 0.6);
}

}  // namespace
}  // namespace kys_slam
