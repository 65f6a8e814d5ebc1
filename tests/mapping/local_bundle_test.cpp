// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/local_bundle.h"

#include <gtest/gtest.h>

#include "mapping/local_mapper.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;

FeatureWorld world(double noise) {
  FeatureWorld::Options options;
  options.points = 1500;
  options.pixel_noise = noise;
  return {testing::kitti_camera(), options};
}

/// Moves every landmark and every keyframe but the root by random amounts.
void perturb(Map& map, double metres, double radians) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto vector = [&] { return Eigen::Vector3d(unit(random), unit(random), unit(random)); };
  for (const LandmarkId id : map.landmarks().ids()) {
    map.set_position(id, map.landmark(id).p_w + metres * vector());
  }
  for (const KeyFrameId id : map.keyframes().ids()) {
    if (!map.keyframe(id).parent.valid()) continue;
    Eigen::Matrix<double, 6, 1> delta;
    delta << radians * vector(), 0.3 * metres * vector();
    map.set_pose(id, plus(map.keyframe(id).T_c_w, delta));
  }
}

TEST(LocalBundle, RecoversAPerturbedMapExactly) {
  const std::vector<Rigid3> poses = testing::weaving_poses(7, 0.8);
  const FeatureWorld exact = world(0);
  Map map = testing::map_of_world(exact, poses).map;
  const std::size_t landmarks = map.landmarks().size();
  perturb(map, 0.15, 0.003);
  LocalBundleOptions options;
  options.bundle.iterations = 20;
  options.bundle.refine_iterations = 20;
  options.bundle.function_tolerance = 1e-12;
  const LocalBundleReport report = adjust_locally(map, KeyFrameId{6}, options);
  map.check_consistency();
  EXPECT_EQ(report.keyframes, 7);
  EXPECT_EQ(report.fixed, 0);
  EXPECT_EQ(report.outliers, 0);
  EXPECT_EQ(map.landmarks().size(), landmarks);
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    const auto error = minus(map.keyframe({k}).T_c_w, poses[k].inverse());
    EXPECT_LT(error.head<3>().norm(), 2e-5) << "keyframe " << k << ", rad";
    EXPECT_LT(error.tail<3>().norm(), 2e-4) << "keyframe " << k << ", m";
  }
  double worst = 0;
  map.landmarks().for_each([&](LandmarkId id, const Landmark& l) {
    const Eigen::Vector3d& truth = exact.points()[id.value].p_w;
    worst = std::max(worst, (l.p_w - truth).norm() / (1 + (truth - poses[3].t()).norm()));
  });
  EXPECT_LT(worst, 2e-3);
}

TEST(LocalBundle, ALandmarkOfOneStereoViewGoesWithItsKeyframe) {
  const std::vector<Rigid3> poses = testing::weaving_poses(7, 0.8);
  Map map = testing::map_of_world(world(0), poses).map;
  const KeyFrameId current{6};
  const KeyFrame& keyframe = map.keyframe(current);
  constexpr std::uint32_t feature = 10;
  ASSERT_TRUE(keyframe.features->has_stereo(feature));
  if (keyframe.landmarks[feature].valid()) map.erase_landmark(keyframe.landmarks[feature]);
  perturb(map, 0.05, 0.002);
  const LandmarkId single{map.landmark_id_end()};
  const Keypoint& k = keyframe.features->keypoint(feature);
  const Eigen::Vector3d p_c =
      map.camera().back_project(k.x, k.y, keyframe.features->depth(feature));
  map.add_landmark(testing::make_landmark(single.value, keyframe.T_c_w.inverse() * p_c, current));
  ASSERT_TRUE(map.add_observation(single, current, feature));
  map.refresh_landmark(single);

  const Eigen::Vector3d before = map.landmark(single).p_w;
  const LocalBundleReport report = adjust_locally(map, current, {});
  map.check_consistency();
  EXPECT_EQ(static_cast<std::size_t>(report.landmarks), map.landmarks().size());
  EXPECT_LT((keyframe.T_c_w * map.landmark(single).p_w - p_c).norm(), 1e-9);
  EXPECT_GT((map.landmark(single).p_w - before).norm(), 1e-3);
  EXPECT_NEAR(map.landmark(single).min_distance,
              map.scales().distance_range(p_c.norm(), k.octave).min, 1e-3);
}

TEST(LocalBundle, TheRootAndFixedKeyframesStay) {
  const std::vector<Rigid3> poses = testing::weaving_poses(12, 1.0);
  const FeatureWorld noisy = world(0.5);
  Map map = testing::map_of_world(noisy, poses).map;
  LocalBundleOptions options;
  options.max_keyframes = 4;
  options.max_fixed = 3;
  std::vector<Rigid3> before;
  for (std::uint32_t k = 0; k < 12; ++k) before.push_back(map.keyframe({k}).T_c_w);
  const LocalBundleReport report = adjust_locally(map, KeyFrameId{11}, options);
  map.check_consistency();
  EXPECT_EQ(report.keyframes, 4);
  EXPECT_EQ(report.fixed, 3);
  int moved = 0;
  for (std::uint32_t k = 0; k < 12; ++k) {
    moved += minus(map.keyframe({k}).T_c_w, before[k]).norm() > 0 ? 1 : 0;
  }
  EXPECT_EQ(moved, 4);
  EXPECT_EQ(minus(map.keyframe({0}).T_c_w, before[0]).norm(), 0);
}

TEST(LocalBundle, WrongObservationsLeaveTheMap) {
  const std::vector<Rigid3> poses = testing::weaving_poses(6, 0.8);
  const FeatureWorld noisy = world(0.3);
  testing::WorldMap built = testing::map_of_world(noisy, poses);
  Map& map = built.map;
  // Exchange the landmarks of ten pairs of features of keyframe 3.
  std::vector<std::uint32_t> features;
  const KeyFrame& keyframe = map.keyframe({3});
  for (std::uint32_t f = 0; f < keyframe.landmarks.size() && features.size() < 20; f += 7) {
    const LandmarkId id = keyframe.landmarks[f];
    if (id.valid() && map.landmark(id).observations.size() >= 4) features.push_back(f);
  }
  ASSERT_EQ(features.size(), 20u);
  for (std::size_t k = 0; k < 20; k += 2) {
    const LandmarkId a = map.keyframe({3}).landmarks[features[k]];
    const LandmarkId b = map.keyframe({3}).landmarks[features[k + 1]];
    map.remove_observation(a, {3});
    map.remove_observation(b, {3});
    ASSERT_TRUE(map.add_observation(a, {3}, features[k + 1]));
    ASSERT_TRUE(map.add_observation(b, {3}, features[k]));
  }
  const LocalBundleReport report = adjust_locally(map, KeyFrameId{5}, {});
  map.check_consistency();
  EXPECT_GE(report.outliers, 18);
  int wrong = 0;
  for (const std::uint32_t f : features) wrong += map.keyframe({3}).landmarks[f].valid() ? 1 : 0;
  EXPECT_LE(wrong, 2) << "two points in one direction may be exchanged unnoticed";
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    EXPECT_LT((map.keyframe({k}).T_c_w.inverse().t() - poses[k].t()).norm(), 0.02);
  }
}

/// The last keyframe sees far landmarks only, which say little of where it is. Returns how far from
/// its true place the bundle leaves it, m.
double error_with_far_landmarks(std::optional<ExpectedMotion> motion) {
  const std::vector<Rigid3> poses = testing::weaving_poses(6, 0.8);
  const FeatureWorld noisy = world(1.0);
  Map map = testing::map_of_world(noisy, poses).map;
  const Rigid3 truth = testing::weaving_pose(4.8);
  const testing::SeenFeatures seen = testing::see(noisy, 6, truth);
  KeyFrameMessage message;
  message.id = {6};
  message.frame_index = 6;
  message.features = seen.features;
  message.tracked.resize(seen.points.size());
  for (std::size_t f = 0; f < seen.points.size(); ++f) {
    const LandmarkId landmark{static_cast<std::uint32_t>(seen.points[f])};
    if (map.has(landmark) && seen.features->depth(f) > 50) message.tracked[f] = landmark;
  }
  message.reference = {5};
  message.T_c_reference = truth.inverse() * poses[5];
  message.T_c_w = message.T_c_reference * map.keyframe({5}).T_c_w;
  message.motion = motion;
  insert_keyframe(map, message);
  map.check_consistency();
  const LocalBundleReport report = adjust_locally(map, KeyFrameId{6}, {});
  map.check_consistency();
  EXPECT_EQ(report.keyframes, 7);
  return (map.keyframe({6}).T_c_w.inverse_t() - truth.t()).norm();
}

TEST(LocalBundle, AnExpectedMotionHoldsAKeyframeThatFarLandmarksDoNot) {
  const Rigid3 T_c_reference =
      testing::weaving_pose(4.8).inverse() * testing::weaving_poses(6, 0.8)[5];
  EXPECT_GT(error_with_far_landmarks(std::nullopt), 0.1);
  EXPECT_LT(error_with_far_landmarks(ExpectedMotion{{5}, T_c_reference, 1, 0.02, 0.01}), 0.03);
  // Measured when lengths were half as large.
  EXPECT_LT(
      error_with_far_landmarks(ExpectedMotion{{5}, scaled(T_c_reference, 0.5), 0.5, 0.02, 0.01}),
      0.03);
}

TEST(LocalBundle, AStopLeavesAValidMap) {
  const FeatureWorld noisy = world(0.5);
  Map map = testing::map_of_world(noisy, testing::weaving_poses(6, 0.8)).map;
  const std::atomic<bool> stop{true};
  adjust_locally(map, KeyFrameId{5}, {}, &stop);
  map.check_consistency();
  EXPECT_EQ(map.keyframes().size(), 6u);
}

}  // namespace
}  // namespace kys_slam
