// SPDX-License-Identifier: BSD-3-Clause
// Stages of the extractor: pyramid, corners, distribution, orientation, descriptor.

#include <gtest/gtest.h>
#include <kys/hamming.h>

#include <array>
#include <cmath>
#include <map>
#include <numbers>

#include "features/corner_detector.h"
#include "features/orb_descriptor.h"
#include "features/pyramid.h"
#include "features/quadtree.h"
#include "synthetic_images.h"

namespace kys_slam {
namespace {

TEST(Pyramid, LevelSizesAreRoundedQuotients) {
  ImagePyramid pyramid;
  PyramidBuilder().build(GrayImage(1226, 370, 9), 1.2, 8, pyramid);
  ASSERT_EQ(pyramid.levels.size(), 8u);
  for (int l = 0; l < 8; ++l) {
    const GrayImage& level = pyramid.levels[static_cast<std::size_t>(l)];
    EXPECT_EQ(level.width(), std::lround(1226 / std::pow(1.2, l)));
    EXPECT_EQ(level.height(), std::lround(370 / std::pow(1.2, l)));
    for (std::size_t i = 0; i < level.size(); ++i) ASSERT_EQ(level.data()[i], 9);
  }
}

TEST(Pyramid, ARampStaysWhereItIs) {
  for (const double factor : {1.1, 1.2, 1.5, 2.0, 3.7}) {
    GrayImage image(120, 90);
    for (int y = 0; y < 90; ++y) {
      for (int x = 0; x < 120; ++x) image.at(x, y) = static_cast<std::uint8_t>(x + y);
    }
    ImagePyramid pyramid;
    PyramidBuilder().build(image, factor, 3, pyramid);
    for (std::size_t l = 1; l < 3; ++l) {
      const GrayImage& level = pyramid.levels[l];
      for (int y = 1; y + 1 < level.height(); ++y) {
        for (int x = 1; x + 1 < level.width(); ++x) {
          const Eigen::Vector2f at =
              pyramid.to_full(l, static_cast<float>(x), static_cast<float>(y));
          ASSERT_NEAR(level.at(x, y), at.x() + at.y(), 1.3) << factor << ' ' << l;
          const Eigen::Vector2f back = pyramid.to_level(l, at.x(), at.y());
          ASSERT_NEAR(back.x(), x, 1e-3);
          ASSERT_NEAR(back.y(), y, 1e-3);
        }
      }
    }
  }
}

TEST(Pyramid, TinyImagesAndChangingSizes) {
  PyramidBuilder builder;
  ImagePyramid pyramid;
  for (const auto& [w, h] : {std::pair{1, 1}, {3, 200}, {200, 1}, {17, 17}, {300, 40}, {2, 2}}) {
    builder.build(GrayImage(w, h, 33), 1.2, 12, pyramid);
    for (const GrayImage& level : pyramid.levels) {
      for (std::size_t i = 0; i < level.size(); ++i) ASSERT_EQ(level.data()[i], 33);
    }
  }
}

TEST(Corners, AreTheLocalMaximaOfTheTwoThresholdRule) {
  const int margin = 19;
  const int cell = 35;
  for (const int width : {120, 166, 167, 230}) {
    const GrayImage image = test::Texture(static_cast<std::uint32_t>(width)).render(width, 130);
    const GrayImage score = fast_score_map(image, 7, margin - 1);
    std::vector<Corner> peaks;
    for (int y = margin; y < image.height() - margin; ++y) {
      for (int x = margin; x < width - margin; ++x) {
        const int s = score.at(x, y);
        bool peak = s > 0;
        for (int k = 0; k < 9; ++k) {
          const int other = score.at(x + k % 3 - 1, y + k / 3 - 1);
          if (k != 4) peak = peak && (k < 4 ? s > other : s >= other);
        }
        if (peak) {
          peaks.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y),
                           static_cast<std::uint8_t>(s)});
        }
      }
    }
    const int columns = (width - 2 * margin) / cell;
    const int rows = (image.height() - 2 * margin) / cell;
    const auto cell_of = [&](const Corner& c) {
      return std::pair(std::min(columns - 1, (c.x - margin) * columns / (width - 2 * margin)),
                       std::min(rows - 1, (c.y - margin) * rows / (image.height() - 2 * margin)));
    };
    std::map<std::pair<int, int>, int> best;
    for (const Corner& c : peaks) best[cell_of(c)] = std::max<int>(best[cell_of(c)], c.score);
    std::erase_if(peaks, [&](const Corner& c) { return c.score < 20 && best[cell_of(c)] >= 20; });
    std::vector<Corner> corners;
    CornerDetector().detect(image, {20, 7, margin, cell}, corners);
    EXPECT_GT(corners.size(), 20u);
    EXPECT_EQ(corners, peaks);
  }
}

TEST(Corners, FaintTextureCountsWhereNothingStrongIs) {
  GrayImage image(220, 120, 100);
  image.at(40, 60) = 112;   // reaches 7 alone in its cell
  image.at(150, 60) = 160;  // reaches 20 and silences its faint neighbour
  image.at(160, 60) = 112;
  std::vector<Corner> corners;
  CornerDetector().detect(image, {}, corners);
  ASSERT_EQ(corners.size(), 2u);
  EXPECT_EQ(corners[0], (Corner{40, 60, 11}));
  EXPECT_EQ(corners[1], (Corner{150, 60, 59}));
}

TEST(Corners, ImagesWithoutTextureOrRoom) {
  CornerDetector detector;
  std::vector<Corner> corners{{1, 1, 1}};
  for (const int value : {0, 128, 255}) {
    detector.detect(GrayImage(100, 100, static_cast<std::uint8_t>(value)), {}, corners);
    EXPECT_TRUE(corners.empty());
  }
  for (const auto& [w, h] : {std::pair{0, 0}, {1, 1}, {38, 100}, {100, 38}, {7, 7}, {39, 39}}) {
    detector.detect(test::noise_image(w, h, 1), {}, corners);
    EXPECT_LE(corners.size(), 1u) << w << ' ' << h;
  }
}

std::vector<Corner> random_corners(int count, std::uint32_t seed) {
  std::map<std::pair<int, int>, int> at;
  std::mt19937 random(seed);
  while (static_cast<int>(at.size()) < count) {
    const int y = static_cast<int>(random() % 200);
    const int x = static_cast<int>(random() % 3 == 0 ? random() % 600 : random() % 90);
    at[{y, x}] = 7 + static_cast<int>(random() % 9);
  }
  std::vector<Corner> corners;
  for (const auto& [place, score] : at) {
    corners.push_back({static_cast<std::int16_t>(place.second),
                       static_cast<std::int16_t>(place.first), static_cast<std::uint8_t>(score)});
  }
  return corners;
}

TEST(Quadtree, GivesTheWantedNumber) {
  const std::vector<Corner> corners = random_corners(3000, 1);
  for (const int wanted : {1, 2, 10, 100, 500, 1500}) {
    const auto kept = distribute(corners, 0, 600, 0, 200, wanted);
    EXPECT_GE(static_cast<int>(kept.size()), wanted);
    EXPECT_LE(static_cast<int>(kept.size()), wanted + 3);
  }
  EXPECT_EQ(distribute(corners, 0, 600, 0, 200, 5000).size(), corners.size());
  EXPECT_TRUE(distribute(corners, 0, 600, 0, 200, 0).empty());
  EXPECT_TRUE(distribute({}, 0, 600, 0, 200, 10).empty());
}

TEST(Quadtree, KeepsDistinctInputCorners) {
  const std::vector<Corner> corners = random_corners(2000, 2);
  std::map<std::pair<int, int>, int> seen;
  for (const Corner& c : distribute(corners, 0, 600, 0, 200, 400)) {
    EXPECT_EQ(++seen[std::pair(int{c.y}, int{c.x})], 1);
    EXPECT_NE(std::find(corners.begin(), corners.end(), c), corners.end());
  }
}

TEST(Quadtree, SpreadsOverTheImageAndPrefersStrongCorners) {
  // A dense cluster and a sparse field: the field keeps nearly all, the cluster its best.
  std::vector<Corner> corners;
  for (int y = 0; y < 50; ++y) {
    for (int x = 0; x < 50; ++x) {
      corners.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y),
                         static_cast<std::uint8_t>(x == 25 && y == 25 ? 200 : 50)});
    }
  }
  for (int i = 0; i < 40; ++i) {
    corners.push_back({static_cast<std::int16_t>(100 + 12 * i),
                       static_cast<std::int16_t>(60 + (i * 53) % 130), 10});
  }
  int field = 0;
  bool strongest = false;
  for (const Corner& c : distribute(corners, 0, 600, 0, 200, 120)) {
    field += c.x >= 100;
    strongest = strongest || c.score == 200;
  }
  EXPECT_GE(field, 35);
  EXPECT_TRUE(strongest);
}

TEST(Quadtree, DoesNotDependOnTheOrderOfItsInput) {
  std::vector<Corner> corners = random_corners(2500, 3);
  const auto expected = distribute(corners, 0, 600, 0, 200, 333);
  std::mt19937 random(4);
  for (int round = 0; round < 3; ++round) {
    std::shuffle(corners.begin(), corners.end(), random);
    EXPECT_EQ(distribute(corners, 0, 600, 0, 200, 333), expected);
  }
}

TEST(Orientation, PointsUpTheGradient) {
  for (int degrees = 0; degrees < 360; degrees += 15) {
    const double a = degrees * std::numbers::pi / 180;
    GrayImage image(45, 45);
    for (int y = 0; y < 45; ++y) {
      for (int x = 0; x < 45; ++x) {
        image.at(x, y) = static_cast<std::uint8_t>(
            std::lround(128 + 3 * ((x - 22) * std::cos(a) + (y - 22) * std::sin(a))));
      }
    }
    const double angle = orientation(image, 22, 22).angle();
    EXPECT_GE(angle, 0);
    EXPECT_LT(angle, 2 * std::numbers::pi);
    EXPECT_NEAR(std::remainder(angle - a, 2 * std::numbers::pi), 0, 0.01) << degrees;
  }
  EXPECT_EQ(orientation(GrayImage(45, 45, 200), 22, 22).angle(), 0);
}

TEST(Descriptor, FollowsARotationInThePlane) {
  // Waves on a slope: the slope gives a clear direction, the waves the bits.
  const auto turned = [](double a) {
    GrayImage image(61, 61);
    for (int y = 0; y < 61; ++y) {
      for (int x = 0; x < 61; ++x) {
        const double u = (x - 30) * std::cos(a) + (y - 30) * std::sin(a);
        const double v = (y - 30) * std::cos(a) - (x - 30) * std::sin(a);
        image.at(x, y) = static_cast<std::uint8_t>(
            std::lround(128 + u + 30 * std::sin(0.5 * u + 1) * std::cos(0.4 * v) +
                        30 * std::sin(0.3 * v + 0.2 * u)));
      }
    }
    return image;
  };
  DescriptorBlur blur;
  GrayImage blurred;
  const auto describe = [&](const GrayImage& image, double& angle) {
    const Orientation turn = orientation(image, 30, 30);
    angle = turn.angle();
    blur.apply(image, blurred);
    return orb_descriptor(blurred, 30, 30, turn);
  };
  double start = 0;
  const kys::Descriptor upright = describe(turned(0), start);
  for (int degrees = 10; degrees < 360; degrees += 10) {
    const double a = degrees * std::numbers::pi / 180;
    double angle = 0;
    const kys::Descriptor d = describe(turned(a), angle);
    EXPECT_NEAR(std::remainder(angle - start - a, 2 * std::numbers::pi), 0, 0.02) << degrees;
    EXPECT_LT(kys::hamming(upright, d), 25) << degrees;
  }
}

TEST(Descriptor, QuarterTurnsAreExact) {
  const GrayImage image = test::noise_image(51, 51, 8);
  GrayImage turned(51, 51);
  for (int y = 0; y < 51; ++y) {
    for (int x = 0; x < 51; ++x) turned.at(50 - y, x) = image.at(x, y);
  }
  const kys::Descriptor a = orb_descriptor(image, 25, 25, {1, 0});
  EXPECT_EQ(a, orb_descriptor(turned, 25, 25, {0, 1}));
}

}  // namespace
}  // namespace kys_slam
