// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/full_bundle.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;

struct Scene {
  FeatureWorld world;
  std::vector<Rigid3> truth;
  Map map;
};

Scene scene(int frames) {
  FeatureWorld::Options options;
  options.points = 2500;
  FeatureWorld world(testing::kitti_camera(), options);
  std::vector<Rigid3> poses = testing::weaving_poses(frames, 1);
  Map map = testing::map_of_world(world, poses).map;
  return {std::move(world), std::move(poses), std::move(map)};
}

/// The map bends away from the truth more and more.
void bend(Map& map, double metres) {
  std::vector<KeyFrameId> ids = map.keyframes().ids();
  std::vector<Rigid3> T_c_w;
  for (const KeyFrameId id : ids) {
    const double s = metres * id.value / 10.0;
    const Rigid3 bent(so3_exp({0, 0.01 * s, 0}), Eigen::Vector3d(s, 0, 0));
    T_c_w.push_back(map.keyframe(id).T_c_w * bent.inverse());
  }
  map.move_keyframes(ids, T_c_w);
}

double worst(const Scene& s) {
  double worst = 0;
  s.map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& k) {
    worst = std::max(worst, (k.T_c_w.inverse().t() - s.truth[id.value].t()).norm());
  });
  return worst;
}

FullBundleOptions exact() {
  FullBundleOptions options;
  options.min_delay = 3;
  options.bundle.iterations = 30;
  options.bundle.refine_iterations = 30;
  options.bundle.function_tolerance = 1e-12;
  return options;
}

class FullBundleTest : public ::testing::TestWithParam<bool> {};

TEST_P(FullBundleTest, StraightensABentMapWhenItIsDue) {
  Scene s = scene(12);
  bend(s.map, 0.05);
  const double before = worst(s);
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  EXPECT_FALSE(full.take_over_if_due(s.map, KeyFrameId{13}));
  EXPECT_EQ(worst(s), before) << "nothing before its time";
  EXPECT_TRUE(full.take_over_if_due(s.map, KeyFrameId{14}));
  s.map.check_consistency();
  EXPECT_LT(worst(s), 1e-3);
  EXPECT_FALSE(full.finish(s.map)) << "once";
}

TEST_P(FullBundleTest, KeyframesAndLandmarksMadeMeanwhileFollow) {
  Scene s = scene(14);
  // Keyframes 12 and 13 and what only they see are made after the start: hide them until then.
  Map whole = s.map;
  Map young = testing::map_of_world(s.world, {s.truth.begin(), s.truth.begin() + 12}).map;
  s.map = std::move(young);
  bend(s.map, 0.05);
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  const Rigid3 bent_last = s.map.keyframe(KeyFrameId{11}).T_c_w;
  const Rigid3 T_12_11 = s.truth[12].inverse() * s.truth[11];
  const testing::SeenFeatures seen = testing::see(s.world, 12, s.truth[12]);
  s.map.add_keyframe(testing::make_keyframe(12, seen.features, T_12_11 * bent_last));
  s.map.connect_to_spanning_tree(KeyFrameId{12}, KeyFrameId{11});
  // A landmark of its own, 10 m ahead of it.
  std::uint32_t feature = 0;
  while (!seen.features->has_stereo(feature)) ++feature;
  const Eigen::Vector3d p_c = s.truth[12].inverse() * s.world.points()[seen.points[feature]].p_w;
  const LandmarkId made{90001};
  s.map.add_landmark(testing::make_landmark(
      made.value, s.map.keyframe(KeyFrameId{12}).T_c_w.inverse() * p_c, KeyFrameId{12}));
  ASSERT_TRUE(s.map.add_observation(made, KeyFrameId{12}, feature));

  ASSERT_TRUE(full.finish(s.map));
  s.map.check_consistency();
  EXPECT_LT(worst(s), 2e-3) << "the new keyframe too";
  EXPECT_LT((s.map.landmark(made).p_w - s.world.points()[seen.points[feature]].p_w).norm(), 5e-3);
}

TEST_P(FullBundleTest, WhatLocalMappingDidMeanwhileStays) {
  Scene s = scene(12);
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  // The map was exact: its correction is nothing, so a later change has to survive.
  Rigid3 moved = s.map.keyframe(KeyFrameId{11}).T_c_w;
  moved.translation.x() += 0.25;
  s.map.set_pose(KeyFrameId{11}, moved);
  ASSERT_TRUE(full.finish(s.map));
  EXPECT_NEAR(s.map.keyframe(KeyFrameId{11}).T_c_w.translation.x(), moved.translation.x(), 1e-4);
}

TEST_P(FullBundleTest, AKeyframeThatTooLittleHoldsFollowsItsParent) {
  Scene s = scene(12);
  const KeyFrameId unconstrained{7};
  int kept = 0;
  for (const LandmarkId id : std::vector<LandmarkId>(s.map.keyframe(unconstrained).landmarks)) {
    if (id.valid() && s.map.has(id) && ++kept > 5) s.map.remove_observation(id, unconstrained);
  }
  ASSERT_GT(kept, 50);
  bend(s.map, 0.5);
  const KeyFrame& keyframe = s.map.keyframe(unconstrained);
  const Rigid3 T_c_parent = keyframe.T_c_w * s.map.keyframe(keyframe.parent).T_c_w.inverse();
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  ASSERT_TRUE(full.finish(s.map));
  s.map.check_consistency();
  const Rigid3 now = s.map.keyframe(unconstrained).T_c_w *
                     s.map.keyframe(s.map.keyframe(unconstrained).parent).T_c_w.inverse();
  EXPECT_LT((now.translation - T_c_parent.translation).norm(), 1e-9);
  EXPECT_LT(worst(s), 0.06) << "a tenth of the bend, as between neighbours";
}

TEST_P(FullBundleTest, ALaterLoopOrAnotherCalibrationMakesItVoid) {
  Scene s = scene(12);
  bend(s.map, 0.05);
  const double before = worst(s);
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  s.map.set_rig(RigCorrection::of_offset(s.map.camera(), 0.1));
  EXPECT_FALSE(full.finish(s.map));
  EXPECT_EQ(worst(s), before);
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  full.cancel();
  EXPECT_FALSE(full.finish(s.map));
  EXPECT_EQ(worst(s), before);
}

TEST_P(FullBundleTest, AnInterruptLeavesTheMapAsItWas) {
  Scene s = scene(12);
  bend(s.map, 0.05);
  const double before = worst(s);
  FullBundle full(exact(), GetParam());
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  full.interrupt();
  EXPECT_FALSE(full.finish(s.map));
  full.start(s.map, KeyFrameId{0}, KeyFrameId{11});
  EXPECT_FALSE(full.finish(s.map)) << "nothing starts any more";
  EXPECT_EQ(worst(s), before);
}

INSTANTIATE_TEST_SUITE_P(InAThreadAndInline, FullBundleTest, ::testing::Bool());

}  // namespace
}  // namespace kys_slam
