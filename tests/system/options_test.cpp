// SPDX-License-Identifier: BSD-3-Clause
// Every options struct of the core, checked as a plain struct.
#include <gtest/gtest.h>
#include <kys/distance_model.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/sequence.h>

#include "features/corner_detector.h"
#include "geometry/stereo_alignment.h"
#include "matching/descriptor_matcher.h"
#include "matching/landmark_search.h"
#include "motion/common_shift.h"
#include "optimization/pose_graph.h"
#include "optimization/pose_optimization.h"
#include "retrieval/place_index.h"
#include "support/option_walk.h"
#include "system/back_end.h"
#include "system/settings_data.h"
#include "tracking/tracker.h"

namespace kys_slam {
namespace {

using test::expect_every_number_checked;

TEST(EveryOption, OfFeaturesAndMatching) {
  expect_every_number_checked<OrbOptions>();
  expect_every_number_checked<CornerOptions>();
  expect_every_number_checked<StereoOptions>();
  expect_every_number_checked<DescriptorMatchOptions>(1);  // check_rotation
  expect_every_number_checked<EpipolarOptions>();
  expect_every_number_checked<SearchOptions>(4);  // two checks, the context, what is taken
}

TEST(EveryOption, OfGeometryAndOptimization) {
  expect_every_number_checked<RansacOptions>(1);  // the seed
  // solver, robust, iterate_points, stop, round_solver
  expect_every_number_checked<BundleOptions>(5);
  expect_every_number_checked<ConsensusOptions>();
  expect_every_number_checked<PoseGraphOptions>(1);  // stop
  expect_every_number_checked<PoseOptions>(1);       // the prior
}

TEST(EveryOption, OfTracking) {
  expect_every_number_checked<KeyFramePolicyOptions>();
  expect_every_number_checked<MotionModelOptions>();
  expect_every_number_checked<SceneSupportOptions>();
  expect_every_number_checked<JudgeOptions, SceneSupportOptions>();
  expect_every_number_checked<IntegrityOptions>();
  expect_every_number_checked<TrackerOptions, ConsensusOptions, KeyFramePolicyOptions,
                              MotionModelOptions, JudgeOptions, IntegrityOptions,
                              InstanceTrackerOptions>();
}

TEST(EveryOption, OfMapping) {
  expect_every_number_checked<LandmarkCullingOptions>();
  expect_every_number_checked<KeyFrameCullingOptions>();
  expect_every_number_checked<FusionOptions>();
  expect_every_number_checked<LocalBundleOptions, BundleOptions>();
  expect_every_number_checked<RigCalibrationOptions>();
  expect_every_number_checked<ThinningOptions>();
  expect_every_number_checked<TriangulationOptions, EpipolarOptions>();
  expect_every_number_checked<LocalMapperOptions, LandmarkCullingOptions, TriangulationOptions,
                              FusionOptions, LocalBundleOptions, KeyFrameCullingOptions,
                              RigCalibrationOptions, ThinningOptions>();
}

TEST(EveryOption, OfPlacesAndLoops) {
  expect_every_number_checked<PlaceOptions>(1);  // the seed
  expect_every_number_checked<PlaceVerificationOptions>();
  expect_every_number_checked<RelocalizationOptions, PlaceVerificationOptions>();
  expect_every_number_checked<FullBundleOptions, BundleOptions>();
  expect_every_number_checked<JointOptions>();
  expect_every_number_checked<LoopOptions, PlaceVerificationOptions, JointOptions, FusionOptions>();
}

TEST(EveryOption, OfMotion) {
  expect_every_number_checked<BeliefUpdateOptions>();
  expect_every_number_checked<CommonShiftOptions>(1, {50, 3});  // which are taken
  expect_every_number_checked<InstanceMotionOptions>();
  expect_every_number_checked<InstanceTrackerOptions, InstanceMotionOptions, BeliefUpdateOptions>();
  expect_every_number_checked<ObjectTrackOptions>();
  expect_every_number_checked<ObjectOptions, ObjectTrackOptions>();
}

TEST(EveryOption, OfTheSystem) {
  expect_every_number_checked<SegmentOptions>();
  expect_every_number_checked<ControlOptions, SegmentOptions>();
  expect_every_number_checked<BackEndOptions, LocalMapperOptions, LoopOptions, FullBundleOptions,
                              RelocalizationOptions>();
  expect_every_number_checked<kys::BeliefOptions>();
}

TEST(EveryOption, OfInputAndEvaluation) {
  expect_every_number_checked<EvaluationOptions>(2);        // the alignment, rpe_all_steps
  expect_every_number_checked<SequenceOptions>(2, {2, 5});  // frames by default, the pair
  ImagePairOptions options;
  options.rate = 0;
  EXPECT_EQ(test::complaint(options), "image_pair.rate must be between 1e-06 and 1000000, is 0");
  options.rate = 10;
  EXPECT_EQ(test::complaint(options), "");
  options.part.start = -1;
  EXPECT_EQ(test::complaint(options), "sequence.start must be between 0 and 1000000000, is -1");
}

TEST(EveryOption, RulesOfSeveralFields) {
  OrbOptions orb;
  orb.fast_threshold = 10;
  orb.fast_min_threshold = 11;
  EXPECT_EQ(test::complaint(orb), "orb.fast_threshold must be at least orb.fast_min_threshold");
  InstanceTrackerOptions motion;
  motion.max_matches = 10;
  motion.motion.min_matches = 11;
  EXPECT_EQ(test::complaint(motion), "motion.max_matches must be at least motion.min_matches");
  EpipolarOptions epipolar;
  epipolar.min_depth = 10;
  epipolar.max_depth = 9;
  EXPECT_NE(test::complaint(epipolar), "");
}

/// The complaint that `make` ends with.
template <typename Make>
std::string refusal(Make&& make) {
  try {
    make();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(EveryOption, ClassesCheckWhatTheyAreMadeWith) {
  const StereoCamera camera{640, 480, 500, 500, 320, 240, 0.12};
  const ScaleLevels scales(1.2, 8);
  const kys::DistanceModel model{kys::ModeOptions()};
  BackEndOptions good;
  EXPECT_EQ(refusal([&] { BackEnd(camera, scales, good, model, false); }), "");
  const auto refused = [&](auto&& change) {
    BackEndOptions options;
    change(options);
    return refusal([&] { BackEnd(camera, scales, options, model, false); });
  };
  const std::string share = "place.min_share must be between 0 and 1, is 9";
  EXPECT_EQ(refused([](auto& o) { o.loop.verification.min_share = 9; }), share);
  EXPECT_EQ(refused([](auto& o) { o.relocalization.verification.min_share = 9; }), share);
  EXPECT_EQ(refused([](auto& o) { o.mapping.triangulation.scale_tolerance = 0; }),
            "mapping.scale_tolerance must be between 1 and 100, is 0");
  EXPECT_EQ(refused([](auto& o) { o.full_bundle.bundle.iterations = -1; }),
            "full_bundle.iterations must be between 0 and 1000, is -1");
  EXPECT_EQ(refused([](auto& o) { o.mapping.bundle.bundle.iterations = -1; }),
            "mapping.bundle_iterations must be between 0 and 1000, is -1");
  EXPECT_EQ(refused([](auto& o) { o.loop.fusion.radius = 0; }),
            "loop.fusion_radius must be between 0.1 and 1000, is 0");
  const auto tracker = [&](const TrackerOptions& options) {
    return refusal([&] { Tracker(camera, scales, options, model, {}); });
  };
  TrackerOptions tracking;
  EXPECT_EQ(tracker(tracking), "");
  tracking.keyframes.min_inliers = 0;
  EXPECT_EQ(tracker(tracking), "keyframes.min_inliers must be between 3 and 60000, is 0");
  RigCalibrationOptions calibration;
  calibration.keyframes = 1;
  EXPECT_NE(refusal([&] { RigCalibration{calibration}; }), "");
  ThinningOptions thinning;
  thinning.patience = -1;
  EXPECT_NE(refusal([&] { Thinning{thinning}; }), "");
  ObjectOptions objects;
  objects.tracks.gate = 0;
  EXPECT_NE(refusal([&] { ObjectLog{objects}; }), "");
  PlaceOptions places;
  places.tables = 17;
  EXPECT_NE(refusal([&] { PlaceIndex{places}; }), "");
  OrbOptions orb;
  orb.levels = 0;
  EXPECT_NE(refusal([&] { OrbExtractor{orb}; }), "");
}

}  // namespace
}  // namespace kys_slam
