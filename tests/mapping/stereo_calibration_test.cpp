// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/stereo_calibration.h"

#include <gtest/gtest.h>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;

constexpr int kKeyFrames = 20;
constexpr double kStep = 0.8;  // m

/// A drive whose disparities all are wrong by `error` px.
Map map_with_error(float error, unsigned seed, int keyframes = kKeyFrames) {
  FeatureWorld::Options options;
  options.points = 2000;
  // As in images: corners that are aligned, and disparities better than their columns.
  options.pixel_noise = 0.2;
  options.aligned = true;
  options.seed = seed;
  const FeatureWorld world(testing::kitti_camera(), options);
  return testing::map_of_world(world, testing::weaving_poses(keyframes, kStep), error).map;
}

double worst_position_error(const Map& map) {
  double worst = 0;
  const std::vector<Rigid3> truth = testing::weaving_poses(kKeyFrames, kStep);
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    worst = std::max(worst, (keyframe.T_c_w.inverse().t() - truth[id.value].t()).norm());
  });
  return worst;
}

TEST(StereoCalibration, FindsAConstantErrorOfAllDisparities) {
  for (const float error : {0.3f, -0.2f}) {
    const Map map = map_with_error(error, 3);
    const DisparityOffset found = estimate_disparity_offset(map, {});
    ASSERT_GT(found.sigma, 0);
    EXPECT_LT(found.sigma, 0.05) << "a drive of 15 m past 2000 points tells a twentieth of a pixel";
    EXPECT_LT(std::abs(found.offset + error), 3 * found.sigma)
        << "error " << error << ": " << found.offset << " +- " << found.sigma;
  }
}

TEST(StereoCalibration, ItsStandardDeviationIsHonest) {
  // Of offsets estimated from independent noise nearly all lie within three deviations.
  double sum_squares = 0;
  constexpr int kRuns = 5;
  for (unsigned seed = 1; seed <= kRuns; ++seed) {
    const DisparityOffset found = estimate_disparity_offset(map_with_error(0, seed), {});
    ASSERT_GT(found.sigma, 0);
    const double score = found.offset / found.sigma;
    EXPECT_LT(std::abs(score), 3.5)
        << "seed " << seed << ": " << found.offset << " +- " << found.sigma;
    sum_squares += score * score;
  }
  EXPECT_LT(sum_squares / kRuns, 4.2) << "99.9 % of the means of five squares lie below";
}

TEST(StereoCalibration, AnErrorIsPutRightInTheMap) {
  Map map = map_with_error(0.3f, 5);
  // The map as it would have been made: adjusted with the wrong disparities.
  StereoCalibration calibration({});
  ASSERT_TRUE(calibration.update(map));
  map.check_consistency();
  EXPECT_NEAR(map.disparity_offset(), -0.3, 0.12);
  EXPECT_FLOAT_EQ(map.keyframe({4}).features->disparity_offset(), map.disparity_offset());
  EXPECT_LT(worst_position_error(map), 0.06);
  EXPECT_FALSE(calibration.update(map)) << "looks again when there are twice as many keyframes";
}

/// Those that know the map by its change sets learn that all of it moved.
TEST(StereoCalibration, TheCorrectedScaleIsPublished) {
  Map map = map_with_error(0.3f, 5);
  ASSERT_TRUE(map.cull_keyframe({9}));
  const double before = map.take_changes().culled_keyframes.front().T_c_parent.t().norm();
  EXPECT_FALSE(map.take_changes().moved);
  StereoCalibrationOptions options;
  options.keyframes = kKeyFrames - 1;
  ASSERT_TRUE(StereoCalibration(options).update(map));
  const ChangeSet changes = map.take_changes();
  EXPECT_TRUE(changes.moved);
  ASSERT_EQ(changes.culled_keyframes.size(), 1u);
  EXPECT_EQ(changes.culled_keyframes.front().id, KeyFrameId{9});
  EXPECT_NEAR(changes.culled_keyframes.front().T_c_parent.t().norm() / before, 1, 0.05);
  EXPECT_NE(changes.culled_keyframes.front().T_c_parent.t().norm(), before);
}

TEST(StereoCalibration, WhatMatchingAloneCouldCauseIsNotApplied) {
  // Found with certainty, as far as noise goes, but no larger than what depth edges do.
  Map map = map_with_error(0.05f, 8);
  const DisparityOffset found = estimate_disparity_offset(map, {});
  EXPECT_GT(std::abs(found.offset), 2.5 * found.sigma);
  EXPECT_FALSE(StereoCalibration({}).update(map));
  EXPECT_EQ(map.disparity_offset(), 0);
  StereoCalibrationOptions exact;
  exact.systematic = 0;
  EXPECT_TRUE(StereoCalibration(exact).update(map));
}

/// Errors of many places cancel: what a few keyframes do not make certain, twice as many do.
TEST(StereoCalibration, ALateEstimateIsTrustedMore) {
  constexpr float kError = 0.057f;  // px, 2.2 times `systematic`, 3.1 times its root of a half
  const int many = 3 * kKeyFrames;
  StereoCalibrationOptions options;
  options.keyframes = many / 2;
  Map few = map_with_error(kError, 5, options.keyframes);
  EXPECT_FALSE(StereoCalibration(options).update(few));
  Map enough = map_with_error(kError, 5, many);
  EXPECT_TRUE(StereoCalibration(options).update(enough));
  EXPECT_NEAR(enough.disparity_offset(), -kError, 0.01);
  Map accurate = map_with_error(0, 5, many);
  EXPECT_FALSE(StereoCalibration(options).update(accurate));
}

TEST(StereoCalibration, AnOffsetPutInOnThinEvidenceIsTakenBack) {
  Map map = map_with_error(0, 7);
  map.set_disparity_offset(0.09f);
  StereoCalibration calibration({});
  EXPECT_TRUE(calibration.update(map));
  EXPECT_EQ(map.disparity_offset(), 0);
  map.check_consistency();
  EXPECT_LT(worst_position_error(map), 0.05) << "m";
}

/// What is taken for an outlier must not depend on it.
TEST(StereoCalibration, TheEstimateDoesNotDependOnThePresentOffset) {
  FeatureWorld::Options options;
  options.points = 2000;
  options.pixel_noise = 0.3;
  options.aligned = false;
  options.seed = 5;
  const FeatureWorld world(testing::kitti_camera(), options);
  Map map = testing::map_of_world(world, testing::weaving_poses(kKeyFrames, kStep)).map;
  const DisparityOffset none = estimate_disparity_offset(map, {});
  ASSERT_GT(none.sigma, 0);
  for (const float present : {-0.1f, 0.1f, 0.3f}) {
    map.set_disparity_offset(present);
    EXPECT_NEAR(present + estimate_disparity_offset(map, {}).offset, none.offset, 0.01) << present;
  }
}

TEST(StereoCalibration, TheLastEstimateRefinesByLessThanItsSystematicError) {
  Map map = map_with_error(0.3f, 5);
  map.set_disparity_offset(-0.21f);
  StereoCalibrationOptions options;
  options.keyframes = 2;  // the last estimate is due at 16
  options.systematic = 0.15;
  StereoCalibration calibration(options);
  EXPECT_FALSE(calibration.update(map));
  EXPECT_FALSE(calibration.update(map));
  EXPECT_FLOAT_EQ(map.disparity_offset(), -0.21f);
  EXPECT_TRUE(calibration.update(map));
  EXPECT_NEAR(map.disparity_offset(), -0.3, 0.05);
  map.check_consistency();
  EXPECT_FALSE(calibration.update(map)) << "there are three estimates";
}

/// The map of a short run has grown since the first estimate, but not to twice its size.
TEST(StereoCalibration, OneMoreEstimateAtTheEndOfAShortRun) {
  StereoCalibrationOptions options;
  options.keyframes = kKeyFrames * 2 / 3;
  options.significance = 1e5;
  StereoCalibration early(options);
  Map map = map_with_error(0.3f, 5);
  EXPECT_FALSE(early.finish(map)) << "there was no first one";
  EXPECT_FALSE(early.update(map)) << "not significant";
  EXPECT_FALSE(early.finish(map)) << "the map has not grown since";

  options.significance = 2.5;
  StereoCalibration calibration(options);
  Map first = map_with_error(0, 5, options.keyframes);
  EXPECT_FALSE(calibration.update(first));
  ASSERT_TRUE(calibration.finish(map));
  EXPECT_NEAR(map.disparity_offset(), -0.3, 0.12);
  EXPECT_LT(worst_position_error(map), 0.06);
  map.check_consistency();
  EXPECT_FALSE(calibration.finish(map)) << "once";
}

TEST(StereoCalibration, AnAccurateRigIsLeftAlone) {
  Map map = map_with_error(0, 6);
  StereoCalibration calibration({});
  EXPECT_FALSE(calibration.update(map));
  EXPECT_EQ(map.disparity_offset(), 0);
}

TEST(StereoCalibration, WaitsForEnoughKeyframesAndCanBeSwitchedOff) {
  Map map = map_with_error(0.3f, 7);
  StereoCalibrationOptions options;
  options.keyframes = kKeyFrames + 1;
  EXPECT_FALSE(StereoCalibration(options).update(map));
  options.keyframes = kKeyFrames;
  options.enabled = false;
  EXPECT_FALSE(StereoCalibration(options).update(map));
  options.enabled = true;
  options.max_correction = 0.1;
  EXPECT_FALSE(StereoCalibration(options).update(map)) << "more than can be a calibration error";
  EXPECT_EQ(map.disparity_offset(), 0);
}

TEST(StereoCalibration, AMapThatSaysTooLittleGivesNoEstimate) {
  const Map empty(testing::kitti_camera(), ScaleLevels(1.2, 8));
  EXPECT_EQ(estimate_disparity_offset(empty, {}).sigma, 0);
  const std::atomic<bool> stop{true};
  EXPECT_EQ(estimate_disparity_offset(map_with_error(0.3f, 7), {}, &stop).sigma, 0);
}

}  // namespace
}  // namespace kys_slam
