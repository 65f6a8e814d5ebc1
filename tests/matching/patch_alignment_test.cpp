// SPDX-License-Identifier: BSD-3-Clause
#include "matching/patch_alignment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/draw_image.h"

namespace kys_slam {
namespace {

constexpr int kSize = 80;

/// Grey levels of a surface: waves in several directions, of 5 px and more.
double texture(double x, double y) {
  return 128 + 30 * std::sin(0.7 * x + 0.4 * y) + 25 * std::sin(1.1 * x - 0.6 * y + 1) +
         20 * std::sin(0.35 * x + 1.0 * y + 2);
}

/// The same with contrast below row 40 alone.
double lower_half(double x, double y) {
  const double share = 1 / (1 + std::exp(-(y - 41)));
  return 128 + share * (texture(x, y) - 128);
}

template <typename Grey>
GrayImage draw(Grey&& grey) {
  return testing::draw_image(kSize, kSize, grey);
}

/// Where the plane is seen in the right image: `at` in column `column`.
struct Plane {
  Eigen::Vector2d at{40, 40};
  double column = 36;
  double slant_u = 0, slant_v = 0;

  template <typename Grey>
  [[nodiscard]] GrayImage right(Grey&& grey) const {
    return draw([&](double x, double y) {
      return grey(at.x() + (x - column - slant_v * (y - at.y())) / (1 + slant_u), y);
    });
  }
};

TEST(PatchAlignment, FindsColumnAndSlantsOfAPlane) {
  const GrayImage left = draw(texture);
  for (const double slant_u : {-0.2, 0.0, 0.15}) {
    for (const double slant_v : {-0.3, 0.0, 0.35}) {
      for (const double fraction : {0.0, 0.25, 0.5, 0.75}) {
        const Plane plane{{40.3, 39.6}, 35 + fraction, slant_u, slant_v};
        const auto found =
            align_patch(left, plane.right(texture), plane.at.cast<float>(), {35.4f, 39.6f});
        ASSERT_TRUE(found) << slant_u << " " << slant_v << " " << fraction;
        EXPECT_NEAR(found->column, plane.column, 0.03) << slant_u << " " << slant_v;
        EXPECT_NEAR(found->slant_u, slant_u, 0.04);
        EXPECT_NEAR(found->slant_v, slant_v, 0.04);
        EXPECT_LT(found->residual, 4) << "grey levels, of interpolation and slants held back";
      }
    }
  }
}

TEST(PatchAlignment, TakesTheCentresDisparityWhereverTheContrastIs) {
  // A road with its only marks in the lower half of the patch: upright, it would be matched 1 px
  // and more beside where its centre is.
  const GrayImage left = draw(lower_half);
  const Plane road{{40, 40}, 36, 0, 0.35};
  const auto found = align_patch(left, road.right(lower_half), {40, 40}, {36.5f, 40});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->column, 36, 0.1);
}

TEST(PatchAlignment, FollowsTheSurfaceAtTheCentre) {
  // The last three columns of the patch are of another surface, 3 px nearer.
  const GrayImage left = draw(texture);
  const GrayImage right =
      draw([](double x, double y) { return x < 38.5 ? texture(x + 4, y) : texture(x + 7, y); });
  const auto found = align_patch(left, right, {40, 40}, {36.4f, 40});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->column, 36, 0.15);
}

TEST(PatchAlignment, TheRowInTheRightImageMayBeAnother) {
  const GrayImage left = draw(texture);
  const GrayImage right = draw([](double x, double y) { return texture(x + 4, y - 1.3); });
  const auto found = align_patch(left, right, {40, 40}, {36.4f, 41.3f});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->column, 36, 0.03);
  EXPECT_LT(found->residual, 4) << "grey levels";
}

TEST(PatchAlignment, BrightnessDoesNotCount) {
  const GrayImage left = draw(texture);
  const Plane plane{{40, 40}, 36.3, 0, 0.2};
  const GrayImage right = plane.right([](double x, double y) { return texture(x, y) - 20; });
  const auto found = align_patch(left, right, {40, 40}, {36, 40});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->column, 36.3, 0.03);
}

TEST(PatchAlignment, FindsNothingWhereThereIsNothing) {
  const GrayImage flat(kSize, kSize, 100);
  const GrayImage left = draw(texture);
  EXPECT_FALSE(align_patch(flat, flat, {40, 40}, {36, 40}));
  EXPECT_FALSE(align_patch(left, left, {40, 40}, {43, 40})) << "further off than it may move";
  for (const float bad : {-1.0f, 2.0f, 78.0f, 1e9f, std::numeric_limits<float>::quiet_NaN()}) {
    EXPECT_FALSE(align_patch(left, left, {40, 40}, {bad, 40})) << bad;
    EXPECT_FALSE(align_patch(left, left, {40, bad}, {36, 40})) << bad;
    EXPECT_FALSE(align_patch(left, left, {bad, 40}, {36, 40})) << bad;
    EXPECT_FALSE(align_patch(left, left, {40, 40}, {36, bad})) << bad;
  }
}

}  // namespace
}  // namespace kys_slam
