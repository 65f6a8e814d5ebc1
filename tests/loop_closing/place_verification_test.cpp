// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/place_verification.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::weaving_pose;

FeatureWorld::Options noisy() {
  FeatureWorld::Options options;
  options.points = 6000;
  options.length = 120;
  options.max_distance = 35;
  options.pixel_noise = 0.5;
  options.flipped_bits = 12;
  return options;
}

class PlaceVerificationTest : public ::testing::Test {
 protected:
  PlaceVerificationTest()
      : world_(testing::kitti_camera(), noisy()),
        map_(testing::map_of_world(world_, testing::weaving_poses(20, 1.5)).map),
        model_(kys::ModeOptions{}) {}

  [[nodiscard]] std::optional<VerifiedPlace> verify(const Rigid3& T_w_c, std::uint32_t place,
                                                    const PlaceVerificationOptions& options = {}) {
    const testing::SeenFeatures seen = testing::see(world_, 1000, T_w_c);
    return verify_place(map_, *seen.features, KeyFrameId{place}, options, model_, statistics_);
  }

  FeatureWorld world_;
  Map map_;
  kys::DistanceModel model_;
  kys::Statistics statistics_;
};

TEST_F(PlaceVerificationTest, FindsThePoseOfAFrameNearAPlace) {
  Rigid3 T_w_c = weaving_pose(15.4);
  T_w_c.translation += Eigen::Vector3d(0.8, -0.2, 0);
  const auto found = verify(T_w_c, 10);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->keyframe, KeyFrameId{10});
  EXPECT_LT((found->T_c_w.inverse().t() - T_w_c.t()).norm(), 0.02) << "m";
  EXPECT_LT(found->T_c_w.rotation.angularDistance(T_w_c.inverse().rotation), 0.001) << "rad";
  EXPECT_GE(found->inliers, 100);
  EXPECT_GE(found->in_view, found->inliers);
  // What it says it sees it does see.
  for (const LandmarkId id : found->landmarks) {
    if (!id.valid()) continue;
    EXPECT_GT((found->T_c_w * map_.landmark(id).p_w).z(), 0);
  }
  EXPECT_GT(statistics_.total(), 0u);
}

TEST_F(PlaceVerificationTest, RejectsAnotherPlace) {
  EXPECT_FALSE(verify(weaving_pose(90), 10));
}

TEST_F(PlaceVerificationTest, WantsAShareOfWhatShouldBeInView) {
  PlaceVerificationOptions options;
  options.min_share = 0.99;
  EXPECT_FALSE(verify(weaving_pose(15.4), 10, options)) << "15 % of the points have no landmark";
  options.min_share = 0.3;
  EXPECT_TRUE(verify(weaving_pose(15.4), 10, options));
}

TEST_F(PlaceVerificationTest, WantsSeveralKeyframesOfThePlaceToSeeIt) {
  PlaceVerificationOptions options;
  options.min_observers = 11;
  options.min_observed = 100000;
  EXPECT_FALSE(verify(weaving_pose(15.4), 10, options));
}

TEST_F(PlaceVerificationTest, IsTheSameEveryTime) {
  const auto a = verify(weaving_pose(15.4), 10);
  const auto b = verify(weaving_pose(15.4), 10);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_c_w.translation, b->T_c_w.translation);
  EXPECT_EQ(a->T_c_w.rotation.coeffs(), b->T_c_w.rotation.coeffs());
  EXPECT_EQ(a->landmarks, b->landmarks);
}

TEST_F(PlaceVerificationTest, AnEmptyFrameIsNowhere) {
  EXPECT_FALSE(verify_place(map_, FrameFeatures(), KeyFrameId{3}, {}, model_, statistics_));
}

/// A facade like another: part of the points at a place are copies of those at another one, the
/// rest are its own.
TEST(PlaceVerification, AFewCopiedPointsDoNotMakeAPlace) {
  FeatureWorld::Options options = noisy();
  const FeatureWorld original(testing::kitti_camera(), options);
  std::vector<FeatureWorld::Point> points = original.points();
  // Everything left of the road between 20 and 45 m again 60 m further on.
  std::vector<FeatureWorld::Point> copies;
  std::erase_if(points,
                [](const auto& p) { return p.p_w.x() < -4 && p.p_w.z() > 80 && p.p_w.z() < 105; });
  for (const auto& p : points) {
    if (p.p_w.x() < -4 && p.p_w.z() > 20 && p.p_w.z() < 45) {
      copies.push_back(p);
      copies.back().p_w.z() += 60;
    }
  }
  ASSERT_GT(copies.size(), 100u);
  points.insert(points.end(), copies.begin(), copies.end());
  const FeatureWorld world(testing::kitti_camera(), options, points);
  const Map map = testing::map_of_world(world, testing::weaving_poses(20, 1.5)).map;
  const kys::DistanceModel model(kys::ModeOptions{});
  kys::Statistics statistics;
  PlaceVerificationOptions strict;
  strict.min_share = 0.5;
  const testing::SeenFeatures seen = testing::see(world, 1000, weaving_pose(75));
  EXPECT_FALSE(verify_place(map, *seen.features, KeyFrameId{10}, strict, model, statistics));
}

}  // namespace
}  // namespace kys_slam
