// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/depth_split.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>

namespace kys_slam {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

/// A road (stuff) with one car, and disparities of both.
struct SplitScene {
  PanopticMap panoptic{ImageOf<std::uint16_t>(120, 80), {{0, 3, false}, {7, 5, true}}, {}};
  ImageOf<float> disparity{120, 80};

  SplitScene() { fill(0, 0, 120, 80, 1, 4); }
  void fill(int x0, int y0, int x1, int y1, std::uint16_t segment, float d) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        panoptic.map.at(x, y) = segment;
        disparity.at(x, y) = d;
      }
    }
  }
  std::size_t split() {
    panoptic.runs = find_runs(panoptic.map);
    split_by_depth(disparity, panoptic);
    return panoptic.segments.size();
  }
};

TEST(DepthSplit, CarBeforeParkedOnes) {
  SplitScene s;
  s.fill(20, 20, 100, 50, 2, 10);
  s.fill(40, 30, 70, 60, 2, 17);
  s.fill(67, 30, 70, 60, 2, kUnknown);  // what one camera sees alone
  s.fill(20, 20, 25, 50, 2, kUnknown);
  ASSERT_EQ(s.split(), 3u);
  const std::vector<InputSegment>& found = s.panoptic.segments;
  EXPECT_EQ(found[0].part, 0) << "the road";
  for (const std::size_t k : {1u, 2u}) {
    EXPECT_EQ(found[k].input_id, 7u);
    EXPECT_EQ(found[k].label, 5);
    EXPECT_TRUE(found[k].thing);
    EXPECT_EQ(found[k].part, k) << "the nearest first";
  }
  EXPECT_EQ(s.panoptic.map.at(50, 40), 2);
  EXPECT_EQ(s.panoptic.map.at(50, 55), 2);
  EXPECT_EQ(s.panoptic.map.at(30, 30), 3);
  EXPECT_EQ(s.panoptic.map.at(90, 40), 3);
  EXPECT_EQ(s.panoptic.map.at(50, 25), 3);
  EXPECT_EQ(s.panoptic.map.at(67, 58), 2) << "unknown: the nearest surface";
  EXPECT_EQ(s.panoptic.map.at(20, 40), 3);
  EXPECT_EQ(s.panoptic.map.at(5, 5), 1);
  const std::vector<SegmentShape> shapes = segment_shapes(s.panoptic.runs, 3);
  EXPECT_EQ(shapes[1].area + shapes[2].area, 80u * 30u + 30u * 10u) << "runs are of the new map";
}

TEST(DepthSplit, LaterSegmentsMoveUp) {
  SplitScene s;
  s.panoptic.segments.push_back({9, 5, true});
  s.fill(20, 20, 60, 50, 2, 10);
  s.fill(40, 20, 60, 50, 2, 17);
  s.fill(80, 20, 110, 50, 3, 30);
  ASSERT_EQ(s.split(), 4u);
  EXPECT_EQ(s.panoptic.map.at(90, 30), 4);
  EXPECT_EQ(s.panoptic.segments[3].input_id, 9u);
  EXPECT_EQ(s.panoptic.segments[3].part, 0);
}

TEST(DepthSplit, OneObjectStaysWhole) {
  {
    SplitScene s;  // a truck along the line of sight
    s.fill(10, 20, 110, 50, 2, 0);
    for (int x = 10; x < 110; ++x) {
      for (int y = 20; y < 50; ++y) s.disparity.at(x, y) = 40 - 0.3F * static_cast<float>(x - 10);
    }
    EXPECT_EQ(s.split(), 2u);
  }
  {
    SplitScene s;  // a mask that is 4 px too large
    s.fill(20, 20, 100, 60, 2, 4);
    s.fill(24, 24, 96, 56, 2, 17);
    EXPECT_EQ(s.split(), 2u);
  }
  {
    SplitScene s;  // behind a pole, and going away from the camera
    s.fill(20, 20, 50, 60, 2, 20);
    s.fill(55, 20, 100, 60, 2, 12);
    EXPECT_EQ(s.split(), 2u);
  }
  {
    SplitScene s;  // a pole that the mask does not leave out
    s.fill(20, 20, 100, 60, 2, 12);
    s.fill(50, 20, 54, 60, 2, 30);
    EXPECT_EQ(s.split(), 2u);
  }
  {
    SplitScene s;  // an object with wrong disparities in a corner
    s.fill(20, 20, 100, 60, 2, 12);
    s.fill(20, 20, 32, 32, 2, 40);
    EXPECT_EQ(s.split(), 2u);
  }
  {
    SplitScene s;  // depths that no object needs two of
    s.fill(20, 20, 100, 60, 2, 12);
    s.fill(60, 20, 100, 60, 2, 14.5F);
    EXPECT_EQ(s.split(), 2u);
  }
}

TEST(DepthSplit, LittleThatIsMeasuredDoesNotSplit) {
  SplitScene s;
  s.fill(10, 20, 110, 60, 2, kUnknown);
  s.fill(10, 20, 50, 60, 2, 40);
  s.fill(80, 20, 100, 40, 2, 10);
  EXPECT_EQ(s.split(), 2u) << "400 of 2000 px";
  s.fill(80, 20, 110, 60, 2, 10);
  EXPECT_EQ(s.split(), 3u) << "1200 of 1800 px";
}

TEST(DepthSplit, BothSidesOfANearerObjectAreOne) {
  SplitScene s;
  s.fill(10, 20, 110, 50, 2, 10);
  s.fill(50, 20, 70, 50, 2, 25);
  ASSERT_EQ(s.split(), 3u);
  EXPECT_EQ(s.panoptic.map.at(60, 30), 2);
  EXPECT_EQ(s.panoptic.map.at(20, 30), 3);
  EXPECT_EQ(s.panoptic.map.at(100, 30), 3);
}

TEST(DepthSplit, StuffAndUnknownDepthStay) {
  SplitScene s;
  s.fill(0, 0, 60, 80, 1, 40);  // a step of the road
  s.fill(70, 20, 110, 50, 2, kUnknown);
  EXPECT_EQ(s.split(), 2u);
}

}  // namespace
}  // namespace kys_slam
