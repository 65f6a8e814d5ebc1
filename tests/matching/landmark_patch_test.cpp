// SPDX-License-Identifier: BSD-3-Clause
#include "matching/landmark_patch.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <cstring>
#include <limits>

#include "support/draw_image.h"

namespace kys_slam {
namespace {

constexpr int kWidth = 96, kHeight = 72;

/// Grey levels of a surface: waves in several directions, of 6 px and more.
double waves(double x, double y) {
  return 128 + 30 * std::sin(0.7 * x + 0.4 * y) + 25 * std::sin(0.9 * x - 0.6 * y + 1) +
         20 * std::sin(0.35 * x + 0.9 * y + 2);
}

template <typename Grey>
ImagePyramid draw_levels(Grey&& grey) {
  ImagePyramid pyramid;
  PyramidBuilder().build(testing::draw_image(kWidth, kHeight, grey), 1.2, 3, pyramid);
  return pyramid;
}

/// The textured surface as it is seen after `warp` (px per px) about `from`, which comes to `to`.
ImagePyramid moved(const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                   const Eigen::Matrix2d& warp) {
  const Eigen::Matrix2d back = warp.inverse();
  return draw_levels([&](double x, double y) {
    const Eigen::Vector2d at = from + back * (Eigen::Vector2d(x, y) - to);
    return waves(at.x(), at.y());
  });
}

Eigen::Matrix2d turned(double angle, double scale) {
  Eigen::Matrix2d warp;
  warp << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  return scale * warp;
}

TEST(LandmarkPatch, IsFoundWhereItsCentreIs) {
  const ImagePyramid before = draw_levels(waves);
  const Eigen::Vector2d from(48.3, 35.6);
  const auto patch = cut_patch(before, 0, 48.3f, 35.6f);
  ASSERT_TRUE(patch);
  for (const double angle : {-0.2, 0.0, 0.3}) {
    for (const double scale : {0.85, 1.0, 1.2}) {
      for (const double fraction : {0.0, 0.25, 0.5, 0.75}) {
        const Eigen::Vector2d to(46 + fraction, 37.4 - fraction);
        const Eigen::Matrix2d warp = turned(angle, scale);
        const auto found =
            align_corner(*patch, warp.cast<float>(), moved(from, to, warp), 0,
                         static_cast<float>(to.x()) + 0.7f, static_cast<float>(to.y()) - 0.6f);
        ASSERT_TRUE(found) << angle << " " << scale << " " << fraction;
        EXPECT_NEAR(found->u, to.x(), 0.04) << angle << " " << scale;
        EXPECT_NEAR(found->v, to.y(), 0.04) << angle << " " << scale;
        EXPECT_LT(found->residual, 4.4) << "a tenth of the contrast: interpolation smooths";
      }
    }
  }
}

TEST(LandmarkPatch, OctavesDiffer) {
  // Seen from nearer, the same octave ratio as the stretch: the patch looks the same.
  const Eigen::Vector2d from(40.4, 33.7), to(45.2, 36.1);
  const ImagePyramid before = draw_levels(waves);
  const ImagePyramid after = moved(from, to, turned(0, 1.44));
  const auto patch = cut_patch(before, 0, 40.4f, 33.7f);
  ASSERT_TRUE(patch);
  const auto found = align_corner(*patch, Eigen::Matrix2f::Identity(), after, 2, 45.9f, 35.5f);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->u, to.x(), 0.06);
  EXPECT_NEAR(found->v, to.y(), 0.06);
}

TEST(LandmarkPatch, BrightnessDoesNotMatter) {
  const ImagePyramid before = draw_levels(waves);
  const auto patch = cut_patch(before, 0, 40, 30);
  const ImagePyramid darker =
      draw_levels([](double x, double y) { return waves(x - 0.4, y + 0.3) - 25; });
  const auto found = align_corner(*patch, Eigen::Matrix2f::Identity(), darker, 0, 40, 30);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->u, 40.4, 0.04);
  EXPECT_NEAR(found->v, 29.7, 0.04);
}

TEST(LandmarkPatch, AnotherSurfaceInThePatchHardlyMovesIt) {
  // What lies behind the right edge of the patch changes.
  const auto scene = [](double shift) {
    return [shift](double x, double y) {
      return x < 43 ? waves(x, y) : 110 + 30 * std::sin(1.3 * (x + shift) + 0.2 * y);
    };
  };
  const auto patch = cut_patch(draw_levels(scene(0)), 0, 40, 30);
  const auto found =
      align_corner(*patch, Eigen::Matrix2f::Identity(), draw_levels(scene(2.2)), 0, 40.5f, 30.4f);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->u, 40, 0.12);
  EXPECT_NEAR(found->v, 30, 0.12);
}

TEST(LandmarkPatch, NothingWithoutContrastInBothDirections) {
  const auto try_on = [](const ImagePyramid& pyramid) {
    const auto patch = cut_patch(pyramid, 0, 40, 30);
    return align_corner(*patch, Eigen::Matrix2f::Identity(), pyramid, 0, 40, 30);
  };
  EXPECT_FALSE(try_on(draw_levels([](double, double) { return 100; })));
  EXPECT_FALSE(try_on(draw_levels([](double x, double) { return 100 + 50 * std::sin(0.8 * x); })));
  EXPECT_TRUE(try_on(draw_levels(waves)));
}

TEST(LandmarkPatch, NothingWhereItStraysOrDoesNotReach) {
  const ImagePyramid pyramid = draw_levels(waves);
  const auto patch = cut_patch(pyramid, 0, 40, 30);
  const Eigen::Matrix2f same = Eigen::Matrix2f::Identity();
  EXPECT_FALSE(align_corner(*patch, same, pyramid, 0, 42.5f, 30)) << "2.5 px away";
  EXPECT_FALSE(align_corner(*patch, 0.5f * same, pyramid, 0, 40, 30)) << "needs 10 px";
  EXPECT_FALSE(align_corner(*patch, 0 * same, pyramid, 0, 40, 30));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(align_corner(*patch, nan * same, pyramid, 0, 40, 30));
  EXPECT_FALSE(align_corner(*patch, same, pyramid, 0, nan, 30));
  EXPECT_FALSE(align_corner(*patch, same, pyramid, 0, 1e30f, 30));
  EXPECT_FALSE(align_corner(*patch, same, pyramid, 3, 40, 30)) << "no such octave";
}

TEST(LandmarkPatch, EveryPlaceInTheImageIsRefusedOrRead) {
  // Up to the borders of every level; a sanitizer sees what is read beyond.
  const ImagePyramid pyramid = draw_levels(waves);
  int cut = 0, aligned = 0;
  for (int octave = 0; octave < 3; ++octave) {
    for (float v = -2; v < kHeight + 2; v += 0.5f) {
      for (float u = -2; u < kWidth + 2; u += 0.5f) {
        const auto here = cut_patch(pyramid, octave, u, v);
        if (!here) continue;
        ++cut;
        const auto found = align_corner(*here, Eigen::Matrix2f::Identity(), pyramid, octave, u, v);
        if (!found) continue;
        ++aligned;
        EXPECT_NEAR(found->u, u, 0.06 * std::pow(1.2, octave));
        EXPECT_NEAR(found->v, v, 0.06 * std::pow(1.2, octave));
      }
    }
  }
  EXPECT_GT(cut, 30000);
  EXPECT_GT(aligned, cut * 9 / 10);
}

TEST(LandmarkPatch, EveryInstructionSetGivesTheSameBytes) {
  const ImagePyramid pyramid = draw_levels(waves);
  const auto patch = cut_patch(pyramid, 0, 40.3f, 30.8f);
  patch::CornerWindow window{};
  for (int y = 0; y < patch::kCornerSide; ++y) {
    for (int x = 0; x < patch::kCornerSide; ++x) {
      window.weight[y][x] = 1 / static_cast<float>(1 + std::abs(x - 4) + std::abs(y - 4));
      window.total += window.weight[y][x];
    }
  }
  const float back[4] = {1.1f, -0.2f, 0.15f, 0.9f};
  patch::Template templates[2];
  patch::CornerSums sums[2];
  const GrayImage& image = pyramid.levels[0];
  for (const patch::Kernels* kernels : patch::available_kernels()) {
    const auto k = kernels == patch::available_kernels().front() ? 0 : 1;
    kernels->warp(patch->pixels.data(), back, &templates[k]);
    kernels->sum_up_both(templates[k], window, image.row(25) + 36, image.width(), 0.3f, 0.8f, 2.25f,
                         9, &sums[k]);
    EXPECT_EQ(std::memcmp(&templates[0], &templates[k], sizeof templates[0]), 0) << kernels->name;
    EXPECT_EQ(std::memcmp(&sums[0], &sums[k], sizeof sums[0]), 0) << kernels->name;
  }
  EXPECT_GT(sums[0].uu, 0);
}

}  // namespace
}  // namespace kys_slam
