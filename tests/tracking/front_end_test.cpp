// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/front_end.h"

#include <gtest/gtest.h>
#include <kys/distance_model.h>

#include "support/feature_world.h"

namespace kys_slam {
namespace {

/// The offset changes while a frame waits for the back end: the frame's disparities change with it.
TEST(FrontEnd, AFrameInHandGetsTheNewDisparityOffset) {
  const testing::FeatureWorld world(testing::kitti_camera(), {});
  const kys::DistanceModel model;
  FrontEnd front_end(world.camera(), make_orb_extractor(OrbOptions{}), StereoOptions{},
                     RowOptions{}, model, nullptr);
  FrontEndResult seen = front_end.process(world.look(0, testing::weaving_pose(0)));
  const std::shared_ptr<const FrameFeatures> before = seen.features;
  front_end.renew(seen);
  EXPECT_EQ(seen.features, before) << "nothing changed";

  front_end.set_rig(RigCorrection::of_offset(world.camera(), -0.25));
  front_end.renew(seen);
  EXPECT_EQ(seen.features->rig().offset(), -0.25);
  ASSERT_EQ(seen.features->size(), before->size());
  int with_disparity = 0;
  for (std::size_t i = 0; i < before->size(); ++i) {
    if (before->depth(i) <= 0) continue;
    ++with_disparity;
    const double bf = world.camera().bf();
    EXPECT_NEAR(bf / seen.features->depth(i), bf / before->depth(i) - 0.25, 1e-3);
  }
  EXPECT_GT(with_disparity, 100);
}

}  // namespace
}  // namespace kys_slam
