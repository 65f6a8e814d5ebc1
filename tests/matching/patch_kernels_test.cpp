// SPDX-License-Identifier: BSD-3-Clause
// The loops of patch alignment, for every instruction set that this machine runs: the same bytes,
// and what slow versions of them give.

#include "matching/patch_kernels.h"

#include <gtest/gtest.h>
#include <kys_slam/image.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <random>

namespace kys_slam {
namespace {

using patch::kHalf;
using patch::kSide;
using patch::kSlide;

GrayImage noise(int width, int height, std::uint32_t seed) {
  GrayImage image(width, height);
  std::mt19937 random(seed);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.at(x, y) = static_cast<std::uint8_t>(random() >> 24);
  }
  return image;
}

class PatchKernels : public ::testing::Test {
 protected:
  const GrayImage left_ = noise(60, 40, 1);
  const GrayImage right_ = noise(60, 40, 2);

  [[nodiscard]] patch::Source source(int x, int y, int first) const {
    return {left_.row(y) + x,
            left_.width(),
            left_.width() - x,
            right_.row(y),
            right_.width(),
            right_.width(),
            first,
            0.3f,
            0.7f,
            0.2f};
  }
  /// Grey level between the pixels of two columns and two rows.
  [[nodiscard]] static double between(const GrayImage& image, double x, double y) {
    const auto column = [&](int c) { return std::clamp(c, 0, image.width() - 1); };
    const int c = static_cast<int>(std::floor(x));
    const int r = static_cast<int>(std::floor(y));
    const auto row = [&](int k) {
      const double l = image.at(column(c), k);
      return l + (x - c) * (image.at(column(c + 1), k) - l);
    };
    return row(r) + (y - r) * (row(r + 1) - row(r));
  }
  static patch::Window window() {
    patch::Window window{};
    for (int x = 0; x < patch::kRow; ++x)
      window.dx[x] = static_cast<float>(std::min(x, 10) - kHalf);
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        window.weight[y][x] = 1 / static_cast<float>(1 + std::abs(x - 5) + std::abs(y - 5));
        window.total += window.weight[y][x];
      }
    }
    return window;
  }
};

// The borders of the right image as well: columns beyond them repeat.
constexpr int kFirst[] = {-9, 0, 11, 28, 40};

TEST_F(PatchKernels, PairsAreTheBlendedPixels) {
  for (const patch::Kernels* kernels : patch::available_kernels()) {
    SCOPED_TRACE(kernels->name);
    for (const int first : kFirst) {
      for (const int x : {3, 44, 46}) {  // of the last two, less than a whole row may be read
        patch::Pair pair;
        kernels->prepare(source(x, 5, first), &pair);
        for (int r = 0; r < kSide; ++r) {
          for (int k = 0; k < kSide; ++k) {
            const double u = x + 1 + k + 0.3, v = 5 + r + 0.7;
            ASSERT_NEAR(pair.wanted[r][k], between(left_, u, v), 1e-3);
            ASSERT_NEAR(pair.gradient[r][k],
                        (between(left_, u + 1, v) - between(left_, u - 1, v)) / 2, 1e-3);
          }
          for (int k = 0; k < patch::kStrip; ++k) {
            ASSERT_NEAR(pair.strip[r][k], between(right_, first + k, 5 + r + 0.2), 1e-3);
          }
        }
      }
    }
  }
}

TEST_F(PatchKernels, SumsAreThoseOfTheDefinition) {
  const patch::Window w = window();
  patch::Pair pair;
  patch::kernels().prepare(source(20, 10, 8), &pair);
  const patch::Place place{14.6f, 1.1f, -0.2f};
  patch::Sums sums;
  patch::kernels().sum_up(pair, w, place, 2, 9, &sums);

  double e[kSide][kSide], mean = 0, square = 0;
  for (int r = 0; r < kSide; ++r) {
    for (int k = 0; k < kSide; ++k) {
      const double at = 14.6 + (k - 5) * 1.1 - (r - 5) * 0.2;
      const auto whole = static_cast<int>(at);
      const float* strip = pair.strip[r] + whole;
      e[r][k] = strip[0] + (at - whole) * (strip[1] - strip[0]) - pair.wanted[r][k];
      mean += w.weight[r][k] * e[r][k] / w.total;
      square += w.weight[r][k] * e[r][k] * e[r][k] / w.total;
    }
  }
  square -= mean * mean;
  double expected[14] = {};
  for (int r = 0; r < kSide; ++r) {
    for (int k = 0; k < kSide; ++k) {
      const double off = e[r][k] - mean;
      const double weight = w.weight[r][k] / (1 + off * off / (2 * square + 9));
      const double g = pair.gradient[r][k];
      const double a[3] = {g, g * (k - 5), g * (r - 5)};
      const double terms[14] = {1,           off,         a[0],        a[1],        a[2],
                                a[0] * a[0], a[1] * a[0], a[1] * a[1], a[2] * a[0], a[2] * a[1],
                                a[2] * a[2], a[0] * off,  a[1] * off,  a[2] * off};
      for (int t = 0; t < 14; ++t) expected[t] += weight * terms[t];
    }
  }
  EXPECT_NEAR(sums.square, square, 1e-3 * square);
  const float got[14] = {sums.w,     sums.we,    sums.a[0],  sums.a[1],  sums.a[2],
                         sums.aa[0], sums.aa[1], sums.aa[2], sums.aa[3], sums.aa[4],
                         sums.aa[5], sums.ae[0], sums.ae[1], sums.ae[2]};
  for (int t = 0; t < 14; ++t) {
    EXPECT_NEAR(got[t], expected[t], 1e-3 * std::abs(expected[t]) + 0.5) << t;
  }
}

TEST_F(PatchKernels, EveryInstructionSetGivesTheSameBytes) {
  const patch::Window w = window();
  for (const int first : kFirst) {
    patch::Pair pairs[2];
    patch::Sums sums[2];
    for (const patch::Kernels* kernels : patch::available_kernels()) {
      const auto k = kernels == patch::available_kernels().front() ? 0 : 1;
      kernels->prepare(source(7, 3, first), &pairs[k]);
      kernels->sum_up(pairs[k], w, {15.4f, 0.9f, 0.3f}, 2.25f, 9, &sums[k]);
      EXPECT_EQ(std::memcmp(&pairs[0], &pairs[k], sizeof pairs[0]), 0) << kernels->name;
      EXPECT_EQ(std::memcmp(&sums[0], &sums[k], sizeof sums[0]), 0) << kernels->name;
    }
  }
}

TEST_F(PatchKernels, SlidesOverTheRightRows) {
  for (const patch::Kernels* kernels : patch::available_kernels()) {
    for (const int x : {0, 39}) {  // up to the last column
      std::int32_t sums[2 * kSlide + 1];
      const int y = 29;  // up to the last row
      kernels->slide(left_.row(y) + 49, left_.width(), right_.row(y) + x, right_.width(), sums);
      for (int s = 0; s <= 2 * kSlide; ++s) {
        const int offset = left_.at(49 + 5, y + 5) - right_.at(x + s + 5, y + 5);
        int expected = 0;
        for (int v = 0; v < kSide; ++v) {
          for (int u = 0; u < kSide; ++u) {
            expected += std::abs(left_.at(49 + u, y + v) - right_.at(x + s + u, y + v) - offset);
          }
        }
        EXPECT_EQ(sums[s], expected) << kernels->name << " " << s;
      }
    }
  }
}

}  // namespace
}  // namespace kys_slam
