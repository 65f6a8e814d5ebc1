// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/object_segments.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "priors/fusion/mask_association.h"

namespace kys_slam {
namespace {

constexpr float kNoDisparity = std::numeric_limits<float>::quiet_NaN();

const kys::LabelSpace& cityscapes() {
  static const kys::LabelSpace space = kys::load_label_space("cityscapes_19");
  return space;
}

std::uint16_t label(std::string_view name) {
  return cityscapes().index_of(name);
}

/// A road with things on it, and disparities of both.
struct ObjectScene {
  PanopticMap panoptic{ImageOf<std::uint16_t>(200, 80), {{0, label("road"), false}}, {}};
  ImageOf<float> disparity{200, 80};

  ObjectScene() { fill(0, 0, 200, 80, 1, 4); }
  void fill(int x0, int y0, int x1, int y1, std::uint16_t segment, float d) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        panoptic.map.at(x, y) = segment;
        disparity.at(x, y) = d;
      }
    }
  }
  std::uint16_t thing(std::string_view name, int x0, int y0, int x1, int y1, float d) {
    const auto number = static_cast<std::uint16_t>(panoptic.segments.size() + 1);
    panoptic.segments.push_back({number, label(name), true});
    fill(x0, y0, x1, y1, number, d);
    return number;
  }
  std::size_t make(const std::vector<ExpectedThing>& expected = {}) {
    panoptic.runs = find_runs(panoptic.map);
    make_objects(disparity, ObjectClasses(cityscapes()), expected, panoptic);
    return panoptic.segments.size() - 1;
  }
  [[nodiscard]] std::uint16_t at(int x, int y) const { return panoptic.map.at(x, y); }
  [[nodiscard]] const InputSegment& segment_at(int x, int y) const {
    return panoptic.segments[at(x, y) - 1U];
  }
};

ExpectedThing expected_at(int x0, int y0, int x1, int y1, const Eigen::Vector3d& velocity) {
  ExpectedThing thing;
  for (int y = y0; y < y1; ++y) thing.mask.push_back({y, x0, x1});
  thing.motion = {velocity, 0.1};
  thing.frames = 10;
  return thing;
}

TEST(ObjectClasses, RolesAreByName) {
  const ObjectClasses classes(cityscapes());
  const auto together = [&](std::string_view a, std::string_view b) {
    EXPECT_EQ(classes.belong_together(label(a), label(b)),
              classes.belong_together(label(b), label(a)));
    return classes.belong_together(label(a), label(b));
  };
  EXPECT_TRUE(together("rider", "bicycle"));
  EXPECT_TRUE(together("person", "motorcycle"));
  EXPECT_TRUE(together("person", "rider"));
  EXPECT_TRUE(together("car", "bus"));
  EXPECT_TRUE(together("truck", "train"));
  EXPECT_FALSE(together("person", "car"));
  EXPECT_FALSE(together("bicycle", "car"));
  EXPECT_FALSE(together("car", "road"));
  EXPECT_FALSE(together("road", "road"));
  EXPECT_FALSE(classes.moves(label("building")));
  EXPECT_FALSE(classes.moves(kys::kVoidLabel));

  const kys::LabelSpace coco = kys::load_label_space("coco_panoptic_133");
  const ObjectClasses others(coco);
  const auto at = [&](std::string_view name) { return coco.index_of(name); };
  EXPECT_TRUE(others.belong_together(at("person"), at("horse")));
  EXPECT_FALSE(others.belong_together(at("person"), at("dog")));
  EXPECT_FALSE(others.belong_together(at("car"), at("chair")));
  for (const std::string_view a : {"cat", "dog", "cow", "boat"}) {
    EXPECT_EQ(others.belong_together(at("sheep"), at(a)), coco.distance(at("sheep"), at(a)) <= 90);
  }
}

TEST(ObjectSegments, ARiderAndTheBicycleAreOne) {
  ObjectScene s;
  s.thing("rider", 90, 10, 110, 40, 30);
  s.thing("bicycle", 85, 40, 120, 70, 30.5F);
  ASSERT_EQ(s.make(), 1u);
  EXPECT_EQ(s.at(100, 20), s.at(100, 60));
  EXPECT_EQ(s.segment_at(100, 20).label, label("bicycle")) << "1050 px, the rider 600";
  EXPECT_EQ(s.segment_at(100, 20).input_id, 3u);
  EXPECT_EQ(s.segment_at(100, 20).part, 0);
  EXPECT_EQ(segment_shapes(s.panoptic.runs, 2)[1].area, 20u * 30u + 35u * 30u);
  EXPECT_EQ(s.at(20, 20), 1);
}

TEST(ObjectSegments, DepthAndClassKeepThingsApart) {
  const auto objects = [](std::string_view a, std::string_view b, float d_b) {
    ObjectScene s;
    s.thing(a, 60, 20, 100, 60, 20);
    s.thing(b, 100, 20, 140, 60, d_b);
    return s.make();
  };
  EXPECT_EQ(objects("car", "truck", 20), 1u);
  EXPECT_EQ(objects("car", "truck", 17), 2u) << "behind";
  EXPECT_EQ(objects("car", "truck", kNoDisparity), 2u) << "nothing says so";
  EXPECT_EQ(objects("car", "car", 20), 2u) << "two instances";
  EXPECT_EQ(objects("car", "person", 20), 2u);
}

TEST(ObjectSegments, ASmallPatchOfAnyClassIsOfWhatSurroundsIt) {
  const auto objects = [](int x0, int x1) {
    ObjectScene s;
    s.thing("person", 80, 10, 120, 70, 30);
    s.thing("car", x0, 30, x1, 45, 30);
    return s.make();
  };
  EXPECT_EQ(objects(90, 105), 1u);
  EXPECT_EQ(objects(80, 118), 2u) << "a quarter of the person";
  EXPECT_EQ(objects(119, 134), 2u) << "beside it";
}

TEST(ObjectSegments, WhatMovesDifferentlyIsNotJoined) {
  const auto objects = [](double speed, int frames) {
    ObjectScene s;
    s.thing("car", 60, 20, 100, 60, 20);
    s.thing("truck", 100, 20, 140, 60, 20);
    std::vector<ExpectedThing> expected = {expected_at(60, 20, 100, 60, {0, 0, 0}),
                                           expected_at(100, 20, 140, 60, {speed, 0, 0})};
    expected[1].frames = frames;
    if (frames == 0) expected[1].motion.reset();
    return s.make(expected);
  };
  EXPECT_EQ(objects(5, 10), 2u);
  EXPECT_EQ(objects(0.5, 10), 1u);
  EXPECT_EQ(objects(5, 0), 1u) << "its motion is not known";
}

TEST(ObjectSegments, WhatCoversTwoThatMoveDifferentlyIsSplit) {
  ObjectScene s;
  s.thing("car", 60, 20, 150, 60, 20);
  std::vector<ExpectedThing> expected = {expected_at(60, 20, 100, 58, {0, 0, 0}),
                                         expected_at(98, 20, 145, 60, {5, 0, 0})};
  const PanopticMap merged = s.panoptic;
  ASSERT_EQ(s.make(expected), 2u);
  EXPECT_NE(s.at(70, 30), s.at(120, 30));
  EXPECT_EQ(s.at(70, 30), s.at(70, 59)) << "the nearest mask";
  EXPECT_EQ(s.at(120, 30), s.at(148, 30));
  for (const int x : {70, 120}) {
    EXPECT_EQ(s.segment_at(x, 30).input_id, 2u);
    EXPECT_GT(s.segment_at(x, 30).part, 0);
  }
  EXPECT_EQ(s.at(20, 20), 1);

  const auto again = [&](const std::vector<ExpectedThing>& things) {
    s.panoptic = merged;
    return s.make(things);
  };
  expected[1].motion->velocity.setZero();
  EXPECT_EQ(again(expected), 1u) << "they move alike";
  expected[1].motion = {{5, 0, 0}, 3};
  EXPECT_EQ(again(expected), 1u) << "within the noise";
  expected[1].motion = {{5, 0, 0}, 0.1};
  expected[1].frames = 1;
  EXPECT_EQ(again(expected), 1u) << "seen once";
}

TEST(ObjectSegments, MotionCountsByItsNoise) {
  const auto motion = [](double speed, double sigma) {
    return std::optional<ThingMotion>({{0, 0, speed}, sigma});
  };
  EXPECT_TRUE(move_apart(motion(0, 0.3), motion(1.5, 0.3)));
  EXPECT_FALSE(move_apart(motion(0, 0.3), motion(0.9, 0.01)));
  EXPECT_FALSE(move_apart(motion(0, 0.3), motion(1.5, 0.5)));
  EXPECT_FALSE(move_apart(motion(0, 0.3), std::nullopt));
}

TEST(ObjectSegments, AnIdentityHasTheClassOfMostFrames) {
  MaskAssociator associator({}, ObjectClasses(cityscapes()).moving());
  ObjectScene s;
  s.thing("car", 60, 20, 100, 60, 20);
  s.panoptic.runs = find_runs(s.panoptic.map);
  const auto see = [&](std::string_view name) {
    s.panoptic.segments[1].label = label(name);
    const std::vector<const PanopticMap*> cameras{&s.panoptic};
    return associator.next_frame(cameras, {})[0][1];
  };
  for (int k = 0; k < 4; ++k) EXPECT_EQ(see("car"), 0);
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(see("bus"), 0);
    EXPECT_EQ(associator.label_of(0), label("car"));
  }
  for (int k = 0; k < 4; ++k) EXPECT_EQ(see("bus"), 0);
  EXPECT_EQ(associator.label_of(0), label("bus"));
}

TEST(ObjectSegments, KeypointsSayWhereThingsAreExpectedAndHowFastTheyAre) {
  MaskAssociator associator({}, ObjectClasses(cityscapes()).moving());
  const std::vector<KeypointEvidence> nothing(2);
  std::vector<KeypointEvidence> evidence(2);
  evidence[1] = {
      .matches = 10, .inliers = 9, .span = 0.1, .velocity = {4, 0, 0}, .velocity_sigma = 0.5};
  for (int k = 0; k < 6; ++k) {
    ObjectScene s;
    s.thing("car", 40 + 10 * k, 20, 80 + 10 * k, 60, 20);
    s.panoptic.runs = find_runs(s.panoptic.map);
    if (k == 1) associator.observe(0, nothing);
    if (k > 1) associator.observe(0, evidence);
    const std::vector<const PanopticMap*> cameras{&s.panoptic};
    ASSERT_EQ(associator.next_frame(cameras, {})[0][1], 0);
    if (k == 1) {
      EXPECT_FALSE(associator.expected(0)[0].motion);
    }
  }
  const std::vector<ExpectedThing> expected = associator.expected(0);
  ASSERT_EQ(expected.size(), 1u);
  EXPECT_EQ(expected[0].frames, 6);
  EXPECT_NEAR(expected[0].motion->velocity.x(), 4, 1e-9);
  EXPECT_LT(expected[0].motion->sigma, 0.5);
  EXPECT_GT(expected[0].motion->sigma, 0.2);
  EXPECT_NEAR(expected[0].mask.front().x0, 100, 2) << "10 px per frame";
  evidence[1].inliers = 4;  // of 10: mixed
  evidence[1].velocity = {-9, 0, 0};
  associator.observe(0, evidence);
  EXPECT_NEAR(associator.expected(0)[0].motion->velocity.x(), 4, 1e-9);
}

}  // namespace
}  // namespace kys_slam
