// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/hamming.h>
#include <kys_slam/binariser.h>
#include <kys_slam/distance_quantiles.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_extractor.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "features/pair_extractor.h"
#include "synthetic_images.h"

namespace kys_slam {
namespace {

/// Two unit vectors at an angle, one after the other.
std::vector<float> pair_at(double angle, int dimensions, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<double> a(static_cast<std::size_t>(dimensions)), b(a.size());
  for (double& x : a) x = normal(random);
  for (double& x : b) x = normal(random);
  const auto dot = [](const std::vector<double>& x, const std::vector<double>& y) {
    double sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i) sum += x[i] * y[i];
    return sum;
  };
  const double length = std::sqrt(dot(a, a));
  for (double& x : a) x /= length;
  const double along = dot(a, b);
  for (std::size_t i = 0; i < b.size(); ++i) b[i] -= along * a[i];
  const double across = std::sqrt(dot(b, b));
  std::vector<float> both;
  for (const double x : a) both.push_back(static_cast<float>(x));
  for (std::size_t i = 0; i < b.size(); ++i) {
    both.push_back(static_cast<float>(std::cos(angle) * a[i] + std::sin(angle) * b[i] / across));
  }
  return both;
}

TEST(Binariser, DistancesFollowTheAngle) {
  constexpr int kPairs = 60;
  std::mt19937 random(3);
  for (const int dimensions : {32, 64, 256}) {
    for (const double angle : {0.0, 0.2, 0.7, 1.5, 2.5}) {
      double sum = 0;
      std::vector<kys::Descriptor> bits;
      for (int k = 0; k < kPairs; ++k) {
        const Binariser binariser(dimensions, static_cast<std::uint64_t>(k));
        binariser.apply(pair_at(angle, dimensions, random), bits);
        sum += kys::hamming(bits[0], bits[1]);
      }
      const double p = angle / std::numbers::pi;
      // Five standard deviations of the mean of independent bits.
      const double bound = 5 * std::sqrt(256 * p * (1 - p) / kPairs) + 0.01;
      EXPECT_NEAR(sum / kPairs, 256 * p, bound) << dimensions << " numbers, " << angle << " rad";
    }
  }
}

TEST(Binariser, TheSameSeedGivesTheSameBytesEverywhere) {
  std::vector<float> ramp(64);
  for (std::size_t i = 0; i < ramp.size(); ++i) ramp[i] = static_cast<float>(i) - 20.0F;
  std::vector<kys::Descriptor> bits, others;
  Binariser(64, 7).apply(ramp, bits);
  // Computed by another program (NumPy); the least sum is far from 0.
  const kys::Descriptor expected{
      {0x4BB7313490E9E20BULL, 0x18F407AD5E250CD1ULL, 0xBF09C6B4EC40BB72ULL, 0xF58C6F10A7A73C69ULL}};
  EXPECT_EQ(bits[0], expected);
  Binariser(64, 8).apply(ramp, others);
  EXPECT_GT(kys::hamming(bits[0], others[0]), 50) << "another seed";
}

TEST(Binariser, ProjectionsOfAGroupAreOrthogonal) {
  // In two dimensions a group is two orthogonal axes: a quarter of a turn changes one sign of two,
  // half a turn both.
  std::mt19937 random(9);
  std::normal_distribution<float> normal;
  for (int k = 0; k < 20; ++k) {
    const float x = normal(random), y = normal(random);
    std::vector<kys::Descriptor> bits;
    Binariser(2, static_cast<std::uint64_t>(k))
        .apply(std::vector<float>{x, y, -y, x, -x, -y}, bits);
    EXPECT_EQ(kys::hamming(bits[0], bits[1]), 128);
    EXPECT_EQ(kys::hamming(bits[0], bits[2]), 256);
  }
}

int distance(const Binariser& binariser, std::vector<float> a, const std::vector<float>& b) {
  a.insert(a.end(), b.begin(), b.end());
  std::vector<kys::Descriptor> bits;
  binariser.apply(a, bits);
  return kys::hamming(bits[0], bits[1]);
}

TEST(Binariser, CirclesHaveTheSameBytesEverywhere) {
  std::vector<float> ramp(64);
  for (std::size_t i = 0; i < ramp.size(); ++i) ramp[i] = static_cast<float>(i) - 20.0F;
  std::vector<kys::Descriptor> bits;
  Binariser(64, 7, {}, 50).apply(ramp, bits);
  // Computed by another program (NumPy); no value is near a step.
  const kys::Descriptor expected{
      {0xB450CE4B4F1659F0ULL, 0x4315911008E84000ULL, 0x041092484C4058F0ULL, 0x4B37913010E96001ULL}};
  EXPECT_EQ(bits[0], expected);
}

TEST(Binariser, DistancesAlongACircle) {
  // One number: 256 steps over a period, twice that around, then the same again.
  const Binariser one(1, 3, {}, 2);
  for (const float from : {-70.0F, -0.3F, 0.0F, 5.1F}) {
    EXPECT_EQ(distance(one, {from}, {from + 0.5F}), 64);
    EXPECT_EQ(distance(one, {from}, {from + 1.0F}), 128);
    EXPECT_EQ(distance(one, {from}, {from - 2.0F}), 256);
    EXPECT_EQ(distance(one, {from}, {from + 3.0F}), 128);
    EXPECT_EQ(distance(one, {from}, {from + 4.0F}), 0);
  }
}

TEST(Binariser, CirclesResolveSmallDifferencesMoreFinelyThanSigns) {
  // Which of two descriptors, the second a fifth farther, is nearer to a third one.
  constexpr int kTries = 400, kDimensions = 64;
  std::mt19937 random(11);
  std::normal_distribution<float> normal(0, 0.1F);
  const auto draw = [&] {
    std::vector<float> x(kDimensions);
    for (float& v : x) v = normal(random);
    return x;
  };
  const auto beside = [&](std::vector<float> x, float length) {
    const std::vector<float> step = draw();
    float sum = 0;
    for (const float v : step) sum += v * v;
    for (std::size_t i = 0; i < x.size(); ++i) x[i] += length / std::sqrt(sum) * step[i];
    return x;
  };
  const Binariser signs(kDimensions), circles(kDimensions, 0, {}, 0.16);
  int by_signs = 0, by_circles = 0;
  for (int k = 0; k < kTries; ++k) {
    const std::vector<float> x = draw(), near = beside(x, 0.25F), far = beside(x, 0.3F);
    const auto mistaken = [&](const Binariser& b) {
      return distance(b, x, near) >= distance(b, x, far) ? 1 : 0;
    };
    by_signs += mistaken(signs);
    by_circles += mistaken(circles);
  }
  EXPECT_LT(2 * by_circles, by_signs) << by_signs << " and " << by_circles << " of " << kTries;
}

TEST(Binariser, TheLengthOfADescriptorDoesNotCountAndTheCentreDoes) {
  std::mt19937 random(5);
  std::vector<float> both = pair_at(1, 48, random);
  std::vector<kys::Descriptor> bits, scaled, moved;
  Binariser(48).apply(both, bits);
  const std::vector<float> centre(48, 0.25F);
  std::vector<float> longer = both, shifted = both;
  for (float& x : longer) x *= 4;
  for (float& x : shifted) x += 0.25F;
  Binariser(48).apply(longer, scaled);
  EXPECT_EQ(bits, scaled);
  Binariser(48, 0, centre).apply(shifted, moved);
  EXPECT_LT(kys::hamming(bits[0], moved[0]), 3) << "but for rounding the same";
}

TEST(Binariser, RefusesWhatIsNoDescriptor) {
  std::vector<kys::Descriptor> bits;
  EXPECT_THROW(Binariser(0), InputError);
  EXPECT_THROW(Binariser(5000), InputError);
  EXPECT_THROW(Binariser(4, 0, {1, 2, 3}), InputError);
  EXPECT_THROW(Binariser(4, 0, {}, -1), InputError);
  EXPECT_THROW(Binariser(4, 0, {}, std::numeric_limits<double>::quiet_NaN()), InputError);
  EXPECT_THROW(Binariser(4, 0, {}, 1e-9), InputError);
  EXPECT_THROW(Binariser(4).apply(std::vector<float>(6), bits), InputError);
  std::vector<float> values(8, 1);
  values[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(Binariser(4).apply(values, bits), InputError);
  values[5] = std::numeric_limits<float>::infinity();
  EXPECT_THROW(Binariser(4).apply(values, bits), InputError);
}

TEST(DistanceQuantiles, OrbKeepsItsNumbers) {
  for (const float bits : {1.0F, 40.0F, 75.0F, 100.0F, 300.0F}) {
    EXPECT_EQ(equivalent_distance(bits, {}), bits);
  }
  for (const float bits : {20.0F, 50.0F, 75.0F, 100.0F}) {
    EXPECT_NEAR(equivalent_distance(bits, orb_distances()), bits, 1e-3);
  }
}

TEST(DistanceQuantiles, DistancesOfHalfTheSizeGiveHalfTheLimits) {
  DistanceQuantiles half = orb_distances();
  for (float& d : half.matching) d /= 2;
  for (float& d : half.other) d /= 2;
  float last = 0;
  for (const float bits : {10.0F, 50.0F, 75.0F, 100.0F, 140.0F}) {
    const float limit = equivalent_distance(bits, half);
    EXPECT_NEAR(limit, bits / 2, 1e-3);
    EXPECT_GT(limit, last);
    last = limit;
  }
  EXPECT_LE(equivalent_distance(1000, half), 256);
  EXPECT_GE(equivalent_distance(0, half), 1);
}

TEST(ExtractorTraits, RefuseWhatMakesNoSense) {
  const auto refused = [](auto&& change) {
    ExtractorTraits traits;
    change(traits);
    EXPECT_THROW(check_traits(traits), InputError);
  };
  EXPECT_NO_THROW(check_traits({}));
  refused([](ExtractorTraits& t) { t.name = ""; });
  refused([](ExtractorTraits& t) { t.name = "two words"; });
  refused([](ExtractorTraits& t) { t.levels = 0; });
  refused([](ExtractorTraits& t) { t.scale_factor = std::nan(""); });
  refused([](ExtractorTraits& t) { t.reach = 0.5; });
  refused([](ExtractorTraits& t) { t.pixel_sigma = 0; });
  refused([](ExtractorTraits& t) { t.distances.matching = {1, 2}; });
  refused([](ExtractorTraits& t) {
    t.distances = orb_distances();
    t.distances.other.back() = 1;
  });
}

TEST(OrbAsAnExtractor, GivesTheFeaturesAndThePyramidOfOrb) {
  const GrayImage left = test::noise_image(320, 200, 1), right = test::noise_image(320, 200, 2);
  OrbOptions options;
  options.features = 300;
  FeatureSet of_left, of_right, plain;
  const std::unique_ptr<FeatureExtractor> extractor = make_orb_extractor(options);
  extractor->extract(left, right, of_left, of_right);
  OrbExtractor orb(options);
  for (const bool is_left : {true, false}) {
    orb.extract(is_left ? left : right, plain);
    const FeatureSet& found = is_left ? of_left : of_right;
    ASSERT_GT(plain.size(), 100U);
    EXPECT_EQ(found.keypoints, plain.keypoints);
    EXPECT_EQ(found.descriptors, plain.descriptors);
    const ImagePyramid* pyramid = extractor->pyramid(is_left ? 0 : 1);
    ASSERT_NE(pyramid, nullptr);
    EXPECT_EQ(pyramid->levels.size(), orb.pyramid().levels.size());
  }
}

/// Hands out features that are made up.
class MadeUp final : public FeatureExtractor {
 public:
  explicit MadeUp(FeatureSet features) : features_(std::move(features)) {
    traits_.name = "made-up";
    traits_.levels = 2;
  }
  [[nodiscard]] const ExtractorTraits& traits() const override { return traits_; }
  void extract(const GrayImage&, const GrayImage&, FeatureSet& l, FeatureSet& r) override {
    l = {};
    r = features_;
  }

 private:
  ExtractorTraits traits_;
  FeatureSet features_;
};

TEST(PairExtractor, ReducesImagesAndRefusesBadFeatures) {
  const GrayImage image = test::noise_image(120, 80, 1);
  std::array<FeatureSet, 2> features;
  const auto extract = [&](const Keypoint& k, std::size_t descriptors = 1) -> std::string {
    PairExtractor pair(
        std::make_unique<MadeUp>(FeatureSet{{k}, std::vector<kys::Descriptor>(descriptors)}));
    try {
      pair.extract(image, image, "000007", features);
    } catch (const InputError& error) {
      return error.what();
    }
    EXPECT_EQ(pair.pyramid(1).levels.size(), 2U);
    EXPECT_EQ(pair.pyramid(1).levels[1].width(), 100);
    return "";
  };
  EXPECT_EQ(extract({.x = 3, .y = 4}), "");
  EXPECT_EQ(features[1].size(), 1U);
  const auto names = [](const std::string& text, const std::string& what) {
    return text.find("frame 000007, right image") != std::string::npos &&
           text.find(what) != std::string::npos;
  };
  EXPECT_TRUE(names(extract({.x = 3, .y = 400}), "outside"));
  EXPECT_TRUE(names(extract({.x = std::nanf(""), .y = 4}), "outside"));
  EXPECT_TRUE(names(extract({.x = 3, .y = 4, .octave = 2}), "extractor made-up says 2 octaves"));
  EXPECT_TRUE(names(extract({.x = 3, .y = 4, .angle = 7}), "orientation"));
  EXPECT_TRUE(names(extract({.x = 3, .y = 4, .response = std::nanf("")}), "response"));
  EXPECT_TRUE(names(extract({.x = 3, .y = 4}, 2), "2 descriptors"));
}

}  // namespace
}  // namespace kys_slam
