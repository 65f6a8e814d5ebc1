// SPDX-License-Identifier: BSD-3-Clause
// Every formula of the method against values worked by hand.

#include <gtest/gtest.h>

#include <cmath>

#include "test_support.h"

namespace kys::test {
namespace {

constexpr float kTolerance = 1e-4f;

Prior on(std::uint16_t label, std::int32_t instance = 1, float scale = 0, float motion = 0,
         bool dynamic = false) {
  return make_prior(label, instance, scale, motion, dynamic);
}

DistanceModel model_of(const ModeOptions& options) {
  return {options, three_classes()};
}

TEST(Formula, StockIsTheHammingDistance) {
  const DistanceModel model;
  EXPECT_EQ(value(model, 0, on(0), on(1)), 0.0f);
  EXPECT_EQ(value(model, 73, on(0, 1, 5, 99), on(1)), 73.0f);
  EXPECT_EQ(value(model, 256, on(0), on(0)), 256.0f);
  EXPECT_FALSE(model.uses_priors());
}

TEST(Formula, Scaled) {
  const DistanceModel model(options_of(Mode::kScaled));
  EXPECT_EQ(value(model, 80, on(0), on(1)), 60.0f);
  EXPECT_EQ(value(model, 256, on(0), on(0)), 192.0f);
}

TEST(Formula, ScaledScalesWithoutPriorsToo) {
  const DistanceModel model(options_of(Mode::kScaled));
  EXPECT_EQ(value(model, 80, Prior{}, Prior{}), 60.0f);
  EXPECT_EQ(value(model, 80, on(0), Prior{}), 60.0f);
  const std::vector<Descriptor> descriptors{with_bits(80), with_bits(100), with_bits(40)};
  const std::vector<std::uint32_t> candidates{0, 1, 2};
  Statistics statistics;
  const BestTwo found = model.best_two(Descriptor{}, Prior{}, descriptors, {}, candidates,
                                       Context::kTemporal, statistics);
  EXPECT_EQ(found.index, 2u);
  EXPECT_EQ(found.best.value, 30.0f);
  EXPECT_EQ(found.second.value, 60.0f);
}

TEST(Formula, HardMismatchRejectsDifferentLabels) {
  const DistanceModel model(options_of(Mode::kHardMismatch));
  EXPECT_EQ(value(model, 80, on(0, 1), on(0, 2)), 80.0f);
  EXPECT_EQ(value(model, 0, on(0), on(1)), kRejected);
  EXPECT_EQ(model.evaluate({}, on(0), {}, on(1), Context::kStereo).tier, Tier::kFiltered);
}

TEST(Formula, SoftFilterRejectsFromTauOn) {
  ModeOptions options = options_of(Mode::kSoftFilter);
  EXPECT_EQ(value(model_of(options), 80, on(0), on(1)), 80.0f);      // S = 100
  EXPECT_EQ(value(model_of(options), 80, on(0), on(2)), kRejected);  // S = 155
  options.tau = 100;
  EXPECT_EQ(value(model_of(options), 80, on(0), on(1)), kRejected);  // S exactly tau
  options.tau = 100.5;
  EXPECT_EQ(value(model_of(options), 80, on(0), on(1)), 80.0f);
  EXPECT_EQ(value(model_of(options), 80, on(2), on(2)), 80.0f);
}

TEST(Formula, SemanticEquation2) {
  const DistanceModel model = model_of(options_of(Mode::kSemantic));
  EXPECT_NEAR(value(model, 80, on(0), on(1)), 0.7 * 80 + 0.3 * 100, kTolerance);  // 86
  EXPECT_NEAR(value(model, 80, on(1), on(2)), 0.7 * 80 + 0.3 * 200, kTolerance);  // 116
  EXPECT_NEAR(value(model, 80, on(1), on(1, 9)), 56, kTolerance);
  EXPECT_NEAR(value(model, 256, on(0), on(2)), 225.7, kTolerance);  // 179.2 + 46.5
}

TEST(Formula, PanopticEquation5Literal) {
  const DistanceModel model = model_of(literal(Mode::kPanoptic));
  // Cross-class: 100 (0.70 + 0.20 * 155/155 + 0.10 * |40-10|/40) = 97.5
  EXPECT_NEAR(value(model, 100, on(0, 1, 10), on(2, 1, 40)), 97.5, kTolerance);
  // 100 (0.70 + 0.20 * 100/155) = 82.9032
  EXPECT_NEAR(value(model, 100, on(0, 1, 7), on(1, 1, 7)), 82.9032258, kTolerance);
  // Cross-instance: 80 (0.75 + 0.10 * 0.5) = 64
  EXPECT_NEAR(value(model, 80, on(1, 1, 10), on(1, 2, 20)), 64, kTolerance);
  // Same instance: 80 * 0.75, whatever the scales
  EXPECT_NEAR(value(model, 80, on(1, 1, 10), on(1, 1, 20)), 60, kTolerance);
}

TEST(Formula, SemanticDistanceAboveSMaxIsNotClipped) {
  const DistanceModel model = model_of(literal(Mode::kPanoptic));
  // S = 200: 100 (0.70 + 0.20 * 200/155) = 95.80645
  EXPECT_NEAR(value(model, 100, on(1), on(2)), 95.8064516, kTolerance);
}

TEST(Formula, ScaleDiscrepancyEquation4AtZero) {
  const DistanceModel model = model_of(literal(Mode::kPanoptic));
  EXPECT_NEAR(value(model, 100, on(1, 1, 0), on(1, 2, 0)), 75, kTolerance);    // both 0: 0
  EXPECT_NEAR(value(model, 100, on(1, 1, 0), on(1, 2, 30)), 85, kTolerance);   // one 0: 1
  EXPECT_NEAR(value(model, 100, on(1, 1, 30), on(1, 2, 30)), 75, kTolerance);  // equal: 0
  EXPECT_NEAR(value(model, 100, on(1, 1, 3e38f), on(1, 2, 1e-38f)), 85, kTolerance);
}

TEST(Formula, NormalisedKeepsSameInstanceExactly) {
  const DistanceModel model = model_of(options_of(Mode::kPanoptic));
  for (int d = 0; d <= 256; ++d) {
    ASSERT_EQ(value(model, d, on(1, 1, 10), on(1, 1, 20)), static_cast<float>(d));
  }
  // Cross-instance: 60 (0.75 + 0.05) / 0.75 = 64; cross-class: 75 (0.7 + 0.2 + 0.075) / 0.75 = 97.5
  EXPECT_NEAR(value(model, 60, on(1, 1, 10), on(1, 2, 20)), 64, kTolerance);
  EXPECT_NEAR(value(model, 75, on(0, 1, 10), on(2, 1, 40)), 97.5, kTolerance);
}

TEST(Formula, KysEquation9) {
  ModeOptions options = literal(Mode::kKys);
  const DistanceModel model = model_of(options);
  const double ln5 = std::log(5.0);  // mu = 4
  EXPECT_NEAR(value(model, 100, on(0, 1, 10, 4), on(2, 1, 40, 1)), 97.5 * (1 + 0.08 * ln5),
              kTolerance);
  EXPECT_NEAR(value(model, 80, on(1, 1, 10, 0), on(1, 2, 20, 4)), 64 * (1 + 0.05 * ln5),
              kTolerance);
  EXPECT_NEAR(value(model, 80, on(1, 1, 10, 4), on(1, 1, 20, 4)), 60 * (1 + 0.02 * ln5),
              kTolerance);
  // The last by hand: ln 5 = 1.6094379, 60 * 1.032188758 = 61.931325
  EXPECT_NEAR(value(model, 80, on(1, 1, 10, 4), on(1, 1, 20, 4)), 61.931325, kTolerance);
  options.normalize = true;
  EXPECT_NEAR(value(model_of(options), 80, on(1, 1, 10, 4), on(1, 1, 20, 4)), 82.575101,
              kTolerance);
}

TEST(Formula, LargestDistanceAndLargestMotion) {
  ModeOptions options = literal(Mode::kKys);
  options.gates = false;
  // 256 (0.7 + 0.2 * 200/155 + 0.1) (1 + 0.08 ln 101), ln 101 = 4.6151205
  EXPECT_NEAR(value(model_of(options), 256, on(1, 1, 0, 100), on(2, 1, 9, 1e9f)), 370.8703, 1e-3f);
}

TEST(Formula, GatesAreStrictAndUnilateral) {
  const DistanceModel model = model_of(options_of(Mode::kKys));
  const auto tier = [&](float mu_a, float mu_b, Context context) {
    return model.evaluate({}, on(1, 1, 0, mu_a), with_bits(9), on(1, 1, 0, mu_b), context).tier;
  };
  const float above_8 = std::nextafter(8.0f, 9.0f);
  const float above_20 = std::nextafter(20.0f, 21.0f);
  EXPECT_EQ(tier(8, 8, Context::kStereo), Tier::kSameInstance);
  EXPECT_EQ(tier(above_8, 0, Context::kStereo), Tier::kGated);
  EXPECT_EQ(tier(0, above_8, Context::kStereo), Tier::kGated);
  EXPECT_EQ(tier(above_8, above_8, Context::kTemporal), Tier::kSameInstance);
  EXPECT_EQ(tier(20, 20, Context::kTemporal), Tier::kSameInstance);
  EXPECT_EQ(tier(above_20, 0, Context::kTemporal), Tier::kGated);
  EXPECT_EQ(tier(0, above_20, Context::kTemporal), Tier::kGated);
  EXPECT_EQ(value(model, 0, on(1, 1, 0, 50), on(1)), kRejected);  // even at distance 0
}

TEST(Formula, VerifiedGatesOnBeliefBetweenFramesOnly) {
  ModeOptions options = options_of(Mode::kVerified);
  options.gate_belief = 0.8;
  const DistanceModel model = model_of(options);
  EXPECT_TRUE(model.uses_belief());
  EXPECT_FALSE(model_of(options_of(Mode::kKys)).uses_belief());
  const auto tier = [&](double p_static, Context context) {
    const Prior prior = with_belief(on(1, 1, 0, 0), p_static);
    EXPECT_EQ(model.admits(prior, context), context != Context::kTemporal || p_static > 0.2);
    return model.evaluate({}, prior, with_bits(9), on(1, 1), context).tier;
  };
  EXPECT_EQ(tier(0.25, Context::kTemporal), Tier::kSameInstance);
  EXPECT_EQ(tier(0.15, Context::kTemporal), Tier::kGated);
  EXPECT_EQ(tier(0.15, Context::kStereo), Tier::kSameInstance);
  EXPECT_EQ(tier(0.15, Context::kInstance), Tier::kSameInstance);
}

TEST(Formula, FollowingOneThingIsNeverGated) {
  for (const Mode mode : all_modes()) {
    const Distance d =
        model_of(options_of(mode))
            .evaluate({}, on(1, 1, 0, 90), with_bits(10), on(1, 1, 0, 90), Context::kInstance);
    EXPECT_LT(d.value, kRejected) << mode_name(mode);
  }
}

TEST(Formula, OnlyKysAndVerifiedHaveGates) {
  for (const Mode mode : all_modes()) {
    const float gated = value(model_of(options_of(mode)), 10, on(1, 1, 0, 90), on(1, 1, 0, 90));
    EXPECT_EQ(gated == kRejected, mode == Mode::kKys || mode == Mode::kVerified) << mode_name(mode);
  }
}

TEST(Formula, LambdaZeroKeepsGates) {
  ModeOptions options = options_of(Mode::kKys);
  options.lambda = {0, 0, 0};
  const DistanceModel model = model_of(options);
  const DistanceModel panoptic = model_of(options_of(Mode::kPanoptic));
  EXPECT_EQ(value(model, 90, on(0, 1, 4, 19), on(2, 1, 9, 3)),
            value(panoptic, 90, on(0, 1, 4, 19), on(2, 1, 9, 3)));
  EXPECT_EQ(value(model, 90, on(0, 1, 4, 21), on(2, 1, 9, 3)), kRejected);
}

TEST(Formula, GatesOnlyKeepsNativeDistanceAndNeedsNoLabelSpace) {
  ModeOptions options = options_of(Mode::kKys);
  options.continuous = false;
  const DistanceModel model(options);
  EXPECT_EQ(value(model, 90, on(0, 1, 4, 19), on(2, 1, 9, 3)), 90.0f);
  EXPECT_EQ(value(model, 90, on(0, 1, 4, 21), on(2, 1, 9, 3)), kRejected);
  EXPECT_EQ(value(model, 90, on(0, 1, 4, 9), on(0, 1, 9, 3), Context::kStereo), kRejected);
  EXPECT_EQ(model.evaluate({}, on(0, 1), {}, on(0, 2), Context::kStereo).tier,
            Tier::kCrossInstance);
}

TEST(Formula, NoValidLabelKeepsNativeDistanceInEveryModeButScaled) {
  Prior nothing = on(0, 1, 10, 90, true);
  nothing.label = kVoidLabel;
  Prior unknown = nothing;
  unknown.label = 3;  // one past the last class
  for (const Mode mode : all_modes()) {
    const DistanceModel model = model_of(options_of(mode));
    const Distance native{mode == Mode::kScaled ? 0.75f * 37 : 37.0f, Tier::kBypassed};
    for (const Prior& prior : {nothing, unknown}) {
      for (const Context context : {Context::kStereo, Context::kTemporal}) {
        const Distance first = model.evaluate({}, prior, with_bits(37), on(1, 1, 3, 90), context);
        const Distance second = model.evaluate({}, on(2, 1, 3, 90), with_bits(37), prior, context);
        EXPECT_EQ(first, native) << mode_name(mode);
        EXPECT_EQ(second, native) << mode_name(mode);
      }
      EXPECT_TRUE(model.keeps_keypoint(prior)) << mode_name(mode);
    }
  }
}

TEST(Formula, OnlyMaskDropsKeypointsAndKeepsDistances) {
  const Prior moving = on(1, 1, 3, 50, true);
  const Prior fast_but_unflagged = on(1, 1, 3, 50, false);
  for (const Mode mode : all_modes()) {
    const DistanceModel model = model_of(options_of(mode));
    EXPECT_EQ(model.keeps_keypoint(moving), mode != Mode::kMask) << mode_name(mode);
    EXPECT_TRUE(model.keeps_keypoint(fast_but_unflagged)) << mode_name(mode);
    EXPECT_EQ(model.uses_priors(), mode != Mode::kStock) << mode_name(mode);
  }
  EXPECT_EQ(value(model_of(options_of(Mode::kMask)), 61, moving, on(0)), 61.0f);
}

TEST(Formula, TiersOfPairs) {
  const DistanceModel model = model_of(options_of(Mode::kPanoptic));
  const auto tier = [&](const Prior& a, const Prior& b) {
    return model.evaluate({}, a, {}, b, Context::kTemporal).tier;
  };
  EXPECT_EQ(tier(on(1, 4), on(1, 4)), Tier::kSameInstance);
  EXPECT_EQ(tier(on(1, 4), on(1, 5)), Tier::kCrossInstance);
  EXPECT_EQ(tier(on(1, 4), on(0, 4)), Tier::kCrossClass);
}

}  // namespace
}  // namespace kys::test
