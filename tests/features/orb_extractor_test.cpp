// SPDX-License-Identifier: BSD-3-Clause
// The extractor as a whole, on rendered textures and on real frames.

#include "features/orb_extractor.h"

#include <gtest/gtest.h>
#include <kys/hamming.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <set>

#include "features/orb_descriptor.h"
#include "synthetic_images.h"

namespace kys_slam {
namespace {

FeatureSet extract(const GrayImage& image, const OrbOptions& options = {}) {
  FeatureSet features;
  OrbExtractor(options).extract(image, features);
  return features;
}

TEST(OrbExtractor, ImagesWithoutTextureGiveNothing) {
  for (const int value : {0, 77, 255}) {
    EXPECT_EQ(extract(GrayImage(640, 480, static_cast<std::uint8_t>(value))).size(), 0u);
  }
  for (const auto& [w, h] : {std::pair{0, 0}, {1, 1}, {2, 500}, {500, 2}, {37, 37}, {38, 38}}) {
    EXPECT_EQ(extract(test::noise_image(w, h, 3)).size(), 0u) << w << ' ' << h;
  }
}

TEST(OrbExtractor, SmallImagesUseTheLevelsThatHaveRoom) {
  const FeatureSet features = extract(test::noise_image(60, 60, 5));
  EXPECT_GT(features.size(), 10u);
  for (const Keypoint& k : features.keypoints) EXPECT_LE(k.octave, 2);
}

TEST(OrbExtractor, RunsAreEqualAndInstancesKeepNothing) {
  const GrayImage a = test::Texture(1).render(320, 200);
  const GrayImage b = test::noise_image(401, 77, 9);
  OrbExtractor extractor{OrbOptions{}};
  FeatureSet first;
  FeatureSet again;
  extractor.extract(a, first);
  extractor.extract(b, again);
  extractor.extract(a, again);
  EXPECT_EQ(first.keypoints, again.keypoints);
  EXPECT_EQ(first.descriptors, again.descriptors);
  EXPECT_EQ(first.keypoints, extract(a).keypoints);
  EXPECT_GT(first.size(), 500u);
}

TEST(OrbExtractor, LevelsGetTheirGeometricShare) {
  const FeatureSet features = extract(test::noise_image(1226, 370, 2));
  double share = 2000 * (1 - 1 / 1.2) / (1 - std::pow(1 / 1.2, 8));
  for (int l = 0; l < 8; ++l, share /= 1.2) {
    const auto count = std::count_if(features.keypoints.begin(), features.keypoints.end(),
                                     [l](const Keypoint& k) { return k.octave == l; });
    EXPECT_NEAR(static_cast<double>(count), share, 4.5) << l;
  }
  EXPECT_TRUE(std::is_sorted(features.keypoints.begin(), features.keypoints.end(),
                             [](const auto& a, const auto& b) { return a.octave < b.octave; }));
}

TEST(OrbExtractor, KeypointsLieInTheImageWithTheirValuesInRange) {
  const GrayImage image = test::Texture(4).render(500, 300);
  for (const Keypoint& k : extract(image).keypoints) {
    EXPECT_TRUE(
        image.contains(static_cast<int>(std::lround(k.x)), static_cast<int>(std::lround(k.y))));
    EXPECT_GE(k.response, 7);
    EXPECT_LE(k.response, 254);
    EXPECT_GE(k.angle, 0);
    EXPECT_LT(k.angle, 6.2831855f);
  }
}

struct Warp {
  double a, b, c, d, e, f, g, h;  // x' = (a x + b y + c) / (g x + h y + 1), y' alike

  [[nodiscard]] std::pair<double, double> operator()(double x, double y) const {
    const double w = g * x + h * y + 1;
    return {(a * x + b * y + c) / w, (d * x + e * y + f) / w};
  }
};

/// Of the features whose place is seen in both images: the share that has a feature within 2 px
/// there (scaled by its level), and the share whose nearest descriptor is such a one.
struct Agreement {
  double repeatability = 0;
  double matched = 0;
};

Agreement agreement(const GrayImage& image, const GrayImage& other, const Warp& to_other) {
  const FeatureSet f = extract(image);
  const FeatureSet g = extract(other);
  int seen = 0;
  int repeated = 0;
  int matched = 0;
  for (std::size_t i = 0; i < f.size(); ++i) {
    const Keypoint& k = f.keypoints[i];
    const auto [x, y] = to_other(k.x, k.y);
    const double limit = 2 * std::pow(1.2, k.octave);
    const double border = 20 * std::pow(1.2, k.octave + 1);
    if (x < border || y < border || x >= other.width() - border || y >= other.height() - border) {
      continue;
    }
    ++seen;
    bool near = false;
    std::size_t best = 0;
    int best_distance = 257;
    for (std::size_t j = 0; j < g.size(); ++j) {
      near = near || std::hypot(g.keypoints[j].x - x, g.keypoints[j].y - y) < limit;
      const int d = kys::hamming(f.descriptors[i], g.descriptors[j]);
      if (d < best_distance) {
        best_distance = d;
        best = j;
      }
    }
    repeated += near;
    matched += std::hypot(g.keypoints[best].x - x, g.keypoints[best].y - y) < limit;
  }
  EXPECT_GT(seen, 300);
  return {static_cast<double>(repeated) / seen, static_cast<double>(matched) / seen};
}

TEST(OrbExtractor, FindsAndMatchesTheSamePlacesUnderAHomography) {
  const test::Texture texture(23);
  const GrayImage image = texture.render(640, 400);
  const auto compare = [&](const Warp& to_first, const Warp& to_other) {
    return agreement(image, texture.render(640, 400, to_first), to_other);
  };
  const double c = std::cos(0.4);
  const double s = std::sin(0.4);
  // A rotation about (320, 200) by 0.4 rad, and back.
  const Warp turn{c, -s, 320 - c * 320 + s * 200, s, c, 200 - s * 320 - c * 200, 0, 0};
  const Warp back{c, s, 320 - c * 320 - s * 200, -s, c, 200 + s * 320 - c * 200, 0, 0};
  const Agreement rotated = compare(turn, back);
  EXPECT_GT(rotated.repeatability, 0.75);
  EXPECT_GT(rotated.matched, 0.5);
  const Agreement scaled =
      compare({1 / 1.3, 0, 70, 0, 1 / 1.3, 40, 0, 0}, {1.3, 0, -91, 0, 1.3, -52, 0, 0});
  EXPECT_GT(scaled.repeatability, 0.7);
  EXPECT_GT(scaled.matched, 0.5);
  const Agreement shifted = compare({1, 0, 13.4, 0, 1, 5.7, 0, 0}, {1, 0, -13.4, 0, 1, -5.7, 0, 0});
  EXPECT_GT(shifted.repeatability, 0.75);
  EXPECT_GT(shifted.matched, 0.5);
}

TEST(OrbExtractor, SubpixelPositionsFollowAShift) {
  const test::Texture texture(31);
  const double dx = 0.4;
  const double dy = -0.3;
  const GrayImage image = texture.render(500, 300);
  const GrayImage moved =
      texture.render(500, 300, [&](double x, double y) { return std::pair(x - dx, y - dy); });
  const auto error = [&](bool subpixel) {
    OrbOptions options;
    options.subpixel = subpixel;
    const FeatureSet a = extract(image, options);
    const FeatureSet b = extract(moved, options);
    double sum = 0;
    int count = 0;
    for (const Keypoint& k : a.keypoints) {
      const double scale = std::pow(1.2, k.octave);
      double best = 1.5 * scale;
      for (const Keypoint& other : b.keypoints) {
        if (other.octave != k.octave) continue;
        best = std::min(best, std::hypot(other.x - k.x - dx, other.y - k.y - dy));
      }
      if (best == 1.5 * scale) continue;
      sum += best * best / (scale * scale);
      ++count;
    }
    EXPECT_GT(count, 800);
    return std::sqrt(sum / count);
  };
  EXPECT_LT(error(true), 0.75 * error(false));
}

TEST(OrbOptions, NamesTheSettingThatMakesNoSense) {
  const auto message = [](auto change) {
    OrbOptions options;
    change(options);
    try {
      check_options(options);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message([](OrbOptions&) {}), "");
  EXPECT_NE(message([](OrbOptions& o) { o.features = 0; }).find("features"), std::string::npos);
  EXPECT_NE(message([](OrbOptions& o) { o.levels = 0; }).find("levels"), std::string::npos);
  EXPECT_NE(message([](OrbOptions& o) { o.scale_factor = std::nan(""); }).find("scale_factor"),
            std::string::npos);
  EXPECT_NE(message([](OrbOptions& o) { o.fast_min_threshold = 0; }).find("fast_min_threshold"),
            std::string::npos);
  EXPECT_NE(message([](OrbOptions& o) { o.fast_threshold = 255; }).find("fast_threshold"),
            std::string::npos);
  EXPECT_NE(message([](OrbOptions& o) { o.fast_threshold = 5; }).find("fast_threshold"),
            std::string::npos);
}

TEST(OrbExtractor, RealFramesAreFullAndEvenlyCovered) {
  const char* elsewhere = std::getenv("KYS_SHARED_DATA_DIR");
  const auto folder =
      std::filesystem::path(elsewhere != nullptr ? elsewhere : KYS_SHARED_DATA_DIR) /
      "kitti_06_clip";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no " << folder;
  for (const char* name : {"image_0/000000.png", "image_1/000000.png", "image_0/000050.png"}) {
    const GrayImage image = read_gray(folder / name);
    const FeatureSet features = extract(image);
    EXPECT_NEAR(static_cast<double>(features.size()), 2000, 20) << name;
    std::set<std::pair<int, int>> cells;
    for (const Keypoint& k : features.keypoints) {
      cells.insert({static_cast<int>(k.x) / 70, static_cast<int>(k.y) / 70});
    }
    EXPECT_GE(cells.size(), 60u) << name;  // of 18 x 6; the sky has no texture
  }
}

}  // namespace
}  // namespace kys_slam
