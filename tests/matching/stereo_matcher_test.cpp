// SPDX-License-Identifier: BSD-3-Clause
#include "matching/stereo_matcher.h"

#include <gtest/gtest.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>

#include "support/feature_world.h"
#include "support/rendered_corridor.h"

namespace kys_slam {
namespace {

/// A corridor seen by a small camera, its corners, and how its matches compare with true depth.
class StereoMatcher : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    pair_ = new Pair;
    OrbOptions orb;
    orb.features = 1000;
    OrbExtractor left(orb);
    OrbExtractor right(orb);
    const testing::RenderedCorridor corridor(pair_->camera, 4);
    const StereoFrame frame = corridor.look(0, pair_->T_w_c);
    left.extract(frame.left, pair_->left);
    right.extract(frame.right, pair_->right);
    pair_->left_pyramid = left.pyramid();
    pair_->right_pyramid = right.pyramid();
    for (const Keypoint& k : pair_->left.keypoints) {
      pair_->disparity.push_back(pair_->camera.bf() / corridor.depth(pair_->T_w_c, k.x, k.y));
    }
  }
  static void TearDownTestSuite() {
    delete pair_;
    pair_ = nullptr;
  }

  struct Pair {
    StereoCamera camera{620, 188, 359.4, 359.4, 303.6, 92.6, 0.537};
    Rigid3 T_w_c{so3_exp({0, 0.05, 0}), {0.2, 0, 3}};
    FeatureSet left;
    FeatureSet right;
    ImagePyramid left_pyramid;
    ImagePyramid right_pyramid;
    std::vector<double> disparity;  // true one of every left keypoint, px
  };
  static Pair* pair_;

  std::vector<float> match(const StereoOptions& options = {}) {
    return match_stereo(pair_->camera, scales_, {&pair_->left, {}, &pair_->left_pyramid},
                        {&pair_->right, {}, &pair_->right_pyramid}, options, model_, statistics_)
        .u;
  }
  /// Disparity errors of the matches in pixels of their octave, by size.
  std::vector<double> errors(const std::vector<float>& u_right) const {
    std::vector<double> all;
    for (std::size_t i = 0; i < u_right.size(); ++i) {
      if (std::isnan(u_right[i])) continue;
      const Keypoint& k = pair_->left.keypoints[i];
      all.push_back(std::abs(k.x - u_right[i] - pair_->disparity[i]) / scales_.scale[k.octave]);
    }
    std::sort(all.begin(), all.end());
    return all;
  }

  ScaleLevels scales_{1.2, 8};
  kys::DistanceModel model_;
  kys::Statistics statistics_;
};
StereoMatcher::Pair* StereoMatcher::pair_ = nullptr;

TEST_F(StereoMatcher, MatchesARenderedPairToAFractionOfAPixel) {
  const std::vector<double> error = errors(match());
  ASSERT_GT(error.size(), pair_->left.size() * 4 / 10);
  const auto within = std::upper_bound(error.begin(), error.end(), 1.0) - error.begin();
  RecordProperty("matches", static_cast<int>(error.size()));
  RecordProperty("median_error", std::to_string(error[error.size() / 2]));
  EXPECT_GE(static_cast<double>(within), 0.95 * static_cast<double>(error.size()));
  EXPECT_LT(error[error.size() / 2], 0.15) << "px of the octave";
}

TEST_F(StereoMatcher, RefinementIsWorthItsTime) {
  StereoOptions coarse;
  coarse.refine = false;
  const std::vector<double> without = errors(match(coarse));
  const std::vector<double> with = errors(match());
  EXPECT_LT(with[with.size() / 2], 0.6 * without[without.size() / 2]);
}

TEST_F(StereoMatcher, DisparitiesHaveNoBias) {
  const std::vector<float> u_right = match();
  std::vector<double> signed_error;
  for (std::size_t i = 0; i < u_right.size(); ++i) {
    if (std::isnan(u_right[i])) continue;
    signed_error.push_back(pair_->left.keypoints[i].x - u_right[i] - pair_->disparity[i]);
  }
  std::sort(signed_error.begin(), signed_error.end());
  EXPECT_LT(std::abs(signed_error[signed_error.size() / 2]), 0.03) << "px";
}

TEST_F(StereoMatcher, ADeliberateFaultShowsUp) {
  const std::vector<float> plain = match();
  StereoOptions faulty;
  faulty.added_disparity = 0.5f;
  const std::vector<float> shifted = match(faulty);
  int compared = 0;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (std::isnan(plain[i]) || std::isnan(shifted[i])) continue;
    if (pair_->left.keypoints[i].x - plain[i] < 0.02f) continue;  // at infinity: clamped
    EXPECT_NEAR(plain[i] - shifted[i], 0.5, 1e-3);
    ++compared;
  }
  EXPECT_GT(compared, 100);
}

TEST_F(StereoMatcher, EveryMatchLiesAheadAndNoNearerThanTheBaseline) {
  const std::vector<float> u_right = match();
  for (std::size_t i = 0; i < u_right.size(); ++i) {
    if (std::isnan(u_right[i])) continue;
    const float disparity = pair_->left.keypoints[i].x - u_right[i];
    EXPECT_GT(disparity, 0);
    EXPECT_LT(disparity, pair_->camera.fx);
  }
}

TEST_F(StereoMatcher, IsRepeatable) {
  const auto bytes = [](const std::vector<float>& v) {
    return std::string(reinterpret_cast<const char*>(v.data()), v.size() * sizeof(float));
  };
  const std::string once = bytes(match());
  const kys::Statistics counted = statistics_;
  EXPECT_EQ(once, bytes(match()));
  Worker helper;
  kys::Statistics statistics;
  EXPECT_EQ(once,
            bytes(match_stereo(pair_->camera, scales_, {&pair_->left, {}, &pair_->left_pyramid},
                               {&pair_->right, {}, &pair_->right_pyramid}, {}, model_, statistics,
                               &helper)
                      .u))
      << "in two threads";
  EXPECT_EQ(statistics, counted);
}

TEST_F(StereoMatcher, ImagesWithoutFeaturesGiveNoMatches) {
  const FeatureSet none;
  EXPECT_TRUE(match_stereo(pair_->camera, scales_, {&none, {}, nullptr},
                           {&pair_->right, {}, nullptr}, {}, model_, statistics_)
                  .u.empty());
  for (const float u : match_stereo(pair_->camera, scales_, {&pair_->left, {}, nullptr},
                                    {&none, {}, nullptr}, {}, model_, statistics_)
                           .u) {
    EXPECT_TRUE(std::isnan(u));
  }
}

TEST_F(StereoMatcher, AnUnrelatedRightImageGivesFewMatches) {
  const testing::RenderedCorridor other(pair_->camera, 99);
  const StereoFrame frame = other.look(0, pair_->T_w_c);
  OrbOptions orb;
  orb.features = 1000;
  OrbExtractor extractor(orb);
  FeatureSet features;
  extractor.extract(frame.right, features);
  const auto u_right =
      match_stereo(pair_->camera, scales_, {&pair_->left, {}, &pair_->left_pyramid},
                   {&features, {}, &extractor.pyramid()}, {}, model_, statistics_)
          .u;
  const auto found =
      std::count_if(u_right.begin(), u_right.end(), [](float u) { return !std::isnan(u); });
  const auto good = errors(match()).size();
  EXPECT_LT(static_cast<double>(found), 0.5 * static_cast<double>(good));
}

TEST(StereoMatching, ExactFeaturesGiveExactDisparities) {
  const testing::FeatureWorld world(testing::kitti_camera(), {});
  std::vector<std::size_t> points;
  const StereoFrame frame = world.look(0, Rigid3(), &points);
  kys::Statistics statistics;
  const auto u_right =
      match_stereo(world.camera(), ScaleLevels(1.2, 8), {&*frame.left_features, {}, nullptr},
                   {&*frame.right_features, {}, nullptr}, {}, kys::DistanceModel(), statistics)
          .u;
  std::size_t matched = 0;
  for (std::size_t i = 0; i < u_right.size(); ++i) {
    if (std::isnan(u_right[i])) continue;
    ++matched;
    EXPECT_NEAR(u_right[i], world.camera().project_stereo(world.points()[points[i]].p_w).z(), 1e-3);
  }
  EXPECT_EQ(matched, points.size());
  EXPECT_EQ(statistics.accepted_of(kys::Tier::kBypassed), matched);
}

// What a file calls moving gets as many disparities as its motion takes, the rest of the image all.
TEST(StereoMatching, ThingsCalledMovingGetFewDisparitiesInModeVerified) {
  const testing::FeatureWorld world(testing::kitti_camera(), {});
  const StereoFrame frame = world.look(0, Rigid3());
  const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  kys::Prior moving;
  moving.label = space.index_of("car");
  moving.instance = 7;
  moving.dynamic = 1;
  kys::Prior parked = moving;
  parked.instance = 8;
  parked.dynamic = 0;
  // The left third of the image moves, the middle is parked, the right is unlabelled.
  const auto priors_of = [&](const FeatureSet& features) {
    std::vector<kys::Prior> priors;
    for (const Keypoint& k : features.keypoints) {
      const float third = static_cast<float>(world.camera().width) / 3;
      priors.push_back(k.x < third ? moving : k.x < 2 * third ? parked : kys::Prior());
    }
    return priors;
  };
  const std::vector<kys::Prior> left = priors_of(*frame.left_features);
  const std::vector<kys::Prior> right(frame.right_features->size());
  StereoOptions options;
  options.moving_keypoints = 25;
  const auto matched = [&](kys::Mode mode, const std::vector<kys::Prior>& priors,
                           std::int32_t instance) {
    kys::ModeOptions mode_options;
    mode_options.mode = mode;
    kys::Statistics statistics;
    const auto u_right =
        match_stereo(world.camera(), ScaleLevels(1.2, 8), {&*frame.left_features, priors, nullptr},
                     {&*frame.right_features, right, nullptr}, options, {mode_options, space},
                     statistics)
            .u;
    int count = 0;
    for (std::size_t i = 0; i < u_right.size(); ++i) {
      if (priors[i].instance == instance && !std::isnan(u_right[i])) ++count;
    }
    return count;
  };
  const int all_moving = matched(kys::Mode::kStock, left, moving.instance);
  const int all_parked = matched(kys::Mode::kStock, left, parked.instance);
  const int all_others = matched(kys::Mode::kStock, left, -1);
  ASSERT_GT(all_moving, 50);
  ASSERT_GT(all_parked, 50);
  EXPECT_EQ(matched(kys::Mode::kVerified, left, moving.instance), options.moving_keypoints);
  EXPECT_EQ(matched(kys::Mode::kVerified, left, parked.instance), all_parked);
  EXPECT_EQ(matched(kys::Mode::kVerified, left, -1), all_others);
  options.moving_keypoints = 100000;
  EXPECT_EQ(matched(kys::Mode::kVerified, left, moving.instance), all_moving);
}

TEST(StereoMatching, OptionsThatMakeNoSenseAreNamed) {
  const auto message = [](const StereoOptions& options) -> std::string {
    try {
      check_options(options);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  StereoOptions options;
  EXPECT_EQ(message(options), "");
  options.max_distance = 0;
  EXPECT_NE(message(options).find("stereo.max_distance"), std::string::npos);
  options = {};
  options.row_tolerance = std::nanf("");
  EXPECT_NE(message(options).find("stereo.row_tolerance"), std::string::npos);
  options = {};
  options.added_disparity = INFINITY;
  EXPECT_NE(message(options).find("stereo.added_disparity"), std::string::npos);
}

}  // namespace
}  // namespace kys_slam
