// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/rig_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/map_builder.h"
#include "support/rig_samples.h"

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

constexpr int kAtOffset = static_cast<int>(RigParameter::kOffset);

/// The offset of disparities alone, as the map shows it.
struct Offset {
  double value = 0, sigma = 0;  // px; sigma 0: no estimate
};
Offset offset_of(const Map& map, const std::atomic<bool>* stop = nullptr) {
  const auto found = estimate_rig(map, {}, {{}, rig_prior()}, stop);
  if (!found) return {};
  return {found->correction.offset(), std::sqrt(found->covariance(kAtOffset, kAtOffset))};
}

double worst_position_error(const Map& map) {
  double worst = 0;
  const std::vector<Rigid3> truth = testing::weaving_poses(kKeyFrames, kStep);
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    worst = std::max(worst, (keyframe.T_c_w.inverse().t() - truth[id.value].t()).norm());
  });
  return worst;
}

TEST(RigCalibration, FindsAConstantErrorOfAllDisparities) {
  for (const float error : {0.3f, -0.2f}) {
    const Map map = map_with_error(error, 3);
    const Offset found = offset_of(map);
    ASSERT_GT(found.sigma, 0);
    EXPECT_LT(found.sigma, 0.05) << "a drive of 15 m past 2000 points tells a twentieth of a pixel";
    EXPECT_LT(std::abs(found.value + error), 3 * found.sigma)
        << "error " << error << ": " << found.value << " +- " << found.sigma;
  }
}

TEST(RigCalibration, ItsStandardDeviationIsHonest) {
  // Of offsets estimated from independent noise nearly all lie within three deviations.
  double sum_squares = 0;
  constexpr int kRuns = 5;
  for (unsigned seed = 1; seed <= kRuns; ++seed) {
    const Offset found = offset_of(map_with_error(0, seed));
    ASSERT_GT(found.sigma, 0);
    const double score = found.value / found.sigma;
    EXPECT_LT(std::abs(score), 3.5)
        << "seed " << seed << ": " << found.value << " +- " << found.sigma;
    sum_squares += score * score;
  }
  EXPECT_LT(sum_squares / kRuns, 4.2) << "99.9 % of the means of five squares lie below";
}

TEST(RigCalibration, AnErrorIsPutRightInTheMap) {
  Map map = map_with_error(0.3f, 5);
  // The map as it would have been made: adjusted with the wrong disparities.
  RigCalibration calibration({});
  ASSERT_TRUE(calibration.update(map, map.keyframes().size()));
  map.check_consistency();
  EXPECT_NEAR(map.rig().offset(), -0.3, 0.12);
  EXPECT_FLOAT_EQ(map.keyframe({4}).features->rig().offset(), map.rig().offset());
  EXPECT_LT(worst_position_error(map), 0.06);
  EXPECT_FALSE(calibration.update(map, map.keyframes().size()))
      << "looks again when there are twice as many keyframes";
}

/// Those that know the map by its change sets learn that all of it moved.
TEST(RigCalibration, TheCorrectedScaleIsPublished) {
  Map map = map_with_error(0.3f, 5);
  ASSERT_TRUE(map.cull_keyframe({9}));
  const double before = map.take_changes().culled_keyframes.front().T_c_parent.t().norm();
  EXPECT_FALSE(map.take_changes().moved);
  RigCalibrationOptions options;
  options.keyframes = kKeyFrames - 1;
  ASSERT_TRUE(RigCalibration(options).update(map, map.keyframes().size()));
  const ChangeSet changes = map.take_changes();
  EXPECT_TRUE(changes.moved);
  ASSERT_EQ(changes.culled_keyframes.size(), 1u);
  EXPECT_EQ(changes.culled_keyframes.front().id, KeyFrameId{9});
  EXPECT_NEAR(changes.culled_keyframes.front().T_c_parent.t().norm() / before, 1, 0.05);
  EXPECT_NE(changes.culled_keyframes.front().T_c_parent.t().norm(), before);
}

TEST(RigCalibration, WhatMatchingAloneCouldCauseIsNotApplied) {
  // Found with certainty, as far as noise goes, but no larger than what depth edges do.
  Map map = map_with_error(0.05f, 8);
  const Offset found = offset_of(map);
  EXPECT_GT(std::abs(found.value), 2.5 * found.sigma);
  EXPECT_FALSE(RigCalibration({}).update(map, map.keyframes().size()));
  EXPECT_EQ(map.rig().offset(), 0);
  RigCalibrationOptions exact;
  exact.systematic = 0;
  EXPECT_TRUE(RigCalibration(exact).update(map, map.keyframes().size()));
}

/// Errors of many places cancel: what a few keyframes do not make certain, twice as many do.
TEST(RigCalibration, ALateEstimateIsTrustedMore) {
  constexpr float kError = 0.057f;  // px, 2.2 times `systematic`, 3.1 times its root of a half
  const int many = 3 * kKeyFrames;
  RigCalibrationOptions options;
  options.keyframes = many / 2;
  Map few = map_with_error(kError, 5, options.keyframes);
  EXPECT_FALSE(RigCalibration(options).update(few, few.keyframes().size()));
  Map enough = map_with_error(kError, 5, many);
  EXPECT_TRUE(RigCalibration(options).update(enough, enough.keyframes().size()));
  EXPECT_NEAR(enough.rig().offset(), -kError, 0.01);
  Map accurate = map_with_error(0, 5, many);
  EXPECT_FALSE(RigCalibration(options).update(accurate, accurate.keyframes().size()));
}

TEST(RigCalibration, AnOffsetPutInOnThinEvidenceIsTakenBack) {
  Map map = map_with_error(0, 7);
  map.set_rig(RigCorrection::of_offset(map.camera(), 0.09f));
  RigCalibration calibration({});
  EXPECT_TRUE(calibration.update(map, map.keyframes().size()));
  EXPECT_EQ(map.rig().offset(), 0);
  map.check_consistency();
  EXPECT_LT(worst_position_error(map), 0.05) << "m";
}

/// What is taken for an outlier must not depend on it.
TEST(RigCalibration, TheEstimateDoesNotDependOnThePresentOffset) {
  FeatureWorld::Options options;
  options.points = 2000;
  options.pixel_noise = 0.3;
  options.aligned = false;
  options.seed = 5;
  const FeatureWorld world(testing::kitti_camera(), options);
  Map map = testing::map_of_world(world, testing::weaving_poses(kKeyFrames, kStep)).map;
  const Offset none = offset_of(map);
  ASSERT_GT(none.sigma, 0);
  for (const float present : {-0.1f, 0.1f, 0.3f}) {
    map.set_rig(RigCorrection::of_offset(map.camera(), present));
    EXPECT_NEAR(offset_of(map).value, none.value, 0.01) << present;
  }
}

TEST(RigCalibration, TheLastEstimateRefinesByLessThanItsSystematicError) {
  Map map = map_with_error(0.3f, 5);
  map.set_rig(RigCorrection::of_offset(map.camera(), -0.21f));
  RigCalibrationOptions options;
  options.keyframes = 2;  // the last estimate is due at 16
  options.systematic = 0.15;
  RigCalibration calibration(options);
  EXPECT_FALSE(calibration.update(map, map.keyframes().size()));
  EXPECT_FALSE(calibration.update(map, map.keyframes().size()));
  EXPECT_FLOAT_EQ(static_cast<float>(map.rig().offset()), -0.21f);
  EXPECT_TRUE(calibration.update(map, map.keyframes().size()));
  EXPECT_NEAR(map.rig().offset(), -0.3, 0.05);
  map.check_consistency();
  EXPECT_FALSE(calibration.update(map, map.keyframes().size())) << "there are three estimates";
}

/// The map of a short run has grown since the first estimate, but not to twice its size.
TEST(RigCalibration, OneMoreEstimateAtTheEndOfAShortRun) {
  RigCalibrationOptions options;
  options.keyframes = kKeyFrames * 2 / 3;
  options.significance = 1e5;
  RigCalibration early(options);
  Map map = map_with_error(0.3f, 5);
  EXPECT_FALSE(early.finish(map, map.keyframes().size())) << "there was no first one";
  EXPECT_FALSE(early.update(map, map.keyframes().size())) << "not significant";
  EXPECT_FALSE(early.finish(map, map.keyframes().size())) << "the map has not grown since";

  options.significance = 2.5;
  RigCalibration calibration(options);
  Map first = map_with_error(0, 5, options.keyframes);
  EXPECT_FALSE(calibration.update(first, first.keyframes().size()));
  ASSERT_TRUE(calibration.finish(map, map.keyframes().size()));
  EXPECT_NEAR(map.rig().offset(), -0.3, 0.12);
  EXPECT_LT(worst_position_error(map), 0.06);
  map.check_consistency();
  EXPECT_FALSE(calibration.finish(map, map.keyframes().size())) << "once";
}

TEST(RigCalibration, AnAccurateRigIsLeftAlone) {
  Map map = map_with_error(0, 6);
  RigCalibration calibration({});
  EXPECT_FALSE(calibration.update(map, map.keyframes().size()));
  EXPECT_EQ(map.rig().offset(), 0);
}

TEST(RigCalibration, WaitsForEnoughKeyframesAndCanBeSwitchedOff) {
  Map map = map_with_error(0.3f, 7);
  RigCalibrationOptions options;
  options.keyframes = kKeyFrames + 1;
  EXPECT_FALSE(RigCalibration(options).update(map, map.keyframes().size()));
  options.keyframes = kKeyFrames;
  options.enabled = false;
  EXPECT_FALSE(RigCalibration(options).update(map, map.keyframes().size()));
  options.enabled = true;
  options.max_correction = 0.1;
  EXPECT_FALSE(RigCalibration(options).update(map, map.keyframes().size()))
      << "more than can be a calibration error";
  EXPECT_EQ(map.rig().offset(), 0);
}

TEST(RigCalibration, AMapThatSaysTooLittleGivesNoEstimate) {
  const Map empty(testing::kitti_camera(), ScaleLevels(1.2, 8));
  EXPECT_EQ(offset_of(empty).sigma, 0);
  const std::atomic<bool> stop{true};
  EXPECT_EQ(offset_of(map_with_error(0.3f, 7), &stop).sigma, 0);
}

/// The map of a drive with a bent rig, rows measured, with the correction as rows alone give it.
Map bent_map(const RigCorrection& truth, unsigned seed, int keyframes) {
  FeatureWorld::Options options;
  options.points = 3000;
  options.pixel_noise = 0.1;
  options.aligned = true;
  options.seed = seed;
  const FeatureWorld world(testing::kitti_like(), options);
  const std::vector<Rigid3> poses = testing::weaving_poses(keyframes, kStep);
  Map map = testing::map_of_world(world, poses, 0, true, nullptr, &truth).map;
  std::vector<RowObservation> rows;
  const FrameFeatures& first = *map.keyframe({0}).features;
  for (std::size_t i = 0; i < first.size(); ++i) {
    rows.push_back({first.measured(i), map.scales().scale[first.keypoint(i).octave]});
  }
  map.set_rig(fit_rows(map.camera(), rows, {{}, rig_prior()}).rig);
  return map;
}

/// Error of the correction where there are features: root mean square, px, and over its sigma.
struct FieldError {
  double disparity = 0, row = 0, normalised = 0;
};
FieldError field_error(const RigEstimate& found, const RigCorrection& truth) {
  FieldError error;
  int count = 0;
  for (double u = 150; u < 1100; u += 100) {
    for (double v = 40; v < 340; v += 50) {
      for (const double disparity : {8.0, 30.0}) {
        const Eigen::Vector2d l = truth.measured_left(u, v);
        const Eigen::Vector2d r = truth.measured_right(u, v, u - disparity);
        const RigCorrection::Measured m{static_cast<float>(l.x()), static_cast<float>(l.y()),
                                        static_cast<float>(r.x()), static_cast<float>(r.y())};
        const RigCorrection::Ideal ideal = found.correction.pair(m);
        const double off = ideal.u - ideal.u_right - disparity;
        error.disparity += off * off;
        error.row += ideal.row * ideal.row;
        error.normalised += std::pow(off / found.sigma(m)[2], 2);
        ++count;
      }
    }
  }
  for (double* sum : {&error.disparity, &error.row, &error.normalised}) {
    *sum = std::sqrt(*sum / count);
  }
  return error;
}

TEST(RigCalibration, ABentRigIsFoundFromRowsAndMotion) {
  const RigCorrection truth = testing::bent_rig(testing::kitti_like());
  Map map = bent_map(truth, 11, kKeyFrames);
  ASSERT_TRUE(map.rig().bends());
  const FieldError before = field_error(map.rig_estimate(), truth);
  EXPECT_GT(before.disparity, 0.15) << "rows alone do not tell disparities";
  RigCalibration calibration({});
  ASSERT_TRUE(calibration.update(map, map.keyframes().size()));
  map.check_consistency();
  const FieldError after = field_error(map.rig_estimate(), truth);
  EXPECT_LT(after.disparity, 0.05) << "px";
  EXPECT_LT(after.row, 0.03) << "px";
  EXPECT_LT(after.normalised, 2.5);
  EXPECT_LT(worst_position_error(map), 0.08) << "m";
  for (const KeyFrameId id : map.keyframes().ids()) {
    EXPECT_EQ(map.keyframe(id).features->rig(), map.rig());
  }
}

}  // namespace
}  // namespace kys_slam
