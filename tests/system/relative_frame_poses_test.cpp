// SPDX-License-Identifier: BSD-3-Clause
#include "system/relative_frame_poses.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

Rigid3 at(double x) {
  return {Eigen::Quaterniond::Identity(), {-x, 0, 0}};
}

/// A correction of the disparities makes the whole map larger: frames that are measured relative to
/// a keyframe, present or culled, move away from it as the map does.
TEST(RelativeFramePoses, FollowTheScaleOfTheMap) {
  const StereoCamera camera = testing::kitti_camera();
  Map map(camera, ScaleLevels(1.2, 8));
  for (std::uint32_t id = 0; id < 3; ++id) {
    map.add_keyframe(
        testing::make_keyframe(id, testing::random_features(camera, 10, id), at(5.0 * id)));
    if (id > 0) map.connect_to_spanning_tree({id}, {id - 1});
  }
  RelativeFramePoses poses;
  poses.add({KeyFrameId{0}, at(4), 1});  // 4 m ahead of keyframe 0, as measured at scale 1
  poses.add({KeyFrameId{2}, at(3), 1});
  poses.add({KeyFrameId{}, {}, 1});
  const auto x = [&](std::size_t frame) { return poses.pose(map, frame)->t().x(); };
  EXPECT_NEAR(x(0), 4, 1e-9);
  EXPECT_NEAR(x(1), 13, 1e-9);

  ASSERT_TRUE(map.cull_keyframe({2}));
  map.set_pose({1}, at(5.5));
  map.note_rescaling(1.1);
  poses.add({KeyFrameId{1}, at(2), 1.1});  // measured after the correction
  EXPECT_NEAR(x(0), 4.4, 1e-9);
  EXPECT_NEAR(x(1), 14.3, 1e-9);
  EXPECT_FALSE(poses.pose(map, 2));
  EXPECT_NEAR(x(3), 7.5, 1e-9);

  map.set_pose({1}, at(5));
  map.note_rescaling(1 / 1.1);
  EXPECT_NEAR(x(0), 4, 1e-9);
  EXPECT_NEAR(x(1), 13, 1e-9);
  EXPECT_NEAR(x(3), 5 + 2 / 1.1, 1e-9);
}

}  // namespace
}  // namespace kys_slam
