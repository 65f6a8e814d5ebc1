// SPDX-License-Identifier: BSD-3-Clause
// The inner loops against slow, obvious versions of themselves, for every instruction set that this
// machine runs.

#include "features/kernels.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

#include "features/corner_detector.h"
#include "features/orb_descriptor.h"
#include "features/orb_pattern.h"
#include "features/pyramid.h"
#include "synthetic_images.h"

namespace kys_slam {
namespace {

using kernels::Kernels;

constexpr int kCircle[16][2] = {{0, -3}, {1, -3},  {2, -2},  {3, -1}, {3, 0},  {3, 1},
                                {2, 2},  {1, 3},   {0, 3},   {-1, 3}, {-2, 2}, {-3, 1},
                                {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}};

/// The definition: nine contiguous circle pixels all brighter, or all darker, by more than t.
bool is_corner(const GrayImage& image, int x, int y, int t) {
  for (const int sign : {1, -1}) {
    for (int start = 0; start < 16; ++start) {
      bool all = true;
      for (int k = 0; k < 9 && all; ++k) {
        const auto& d = kCircle[(start + k) % 16];
        all = sign * (image.at(x + d[0], y + d[1]) - image.at(x, y)) > t;
      }
      if (all) return true;
    }
  }
  return false;
}

int reference_score(const GrayImage& image, int x, int y, int min_threshold) {
  if (!is_corner(image, x, y, min_threshold)) return 0;
  int t = min_threshold;
  while (is_corner(image, x, y, t + 1)) ++t;
  return t;
}

/// Patches of flat, faint, strong and saturated pixels, so that arcs of all lengths occur.
GrayImage mixed_image(int width, int height, std::uint32_t seed) {
  GrayImage image = test::noise_image(width, height, seed);
  std::mt19937 random(seed + 1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      std::uint8_t& p = image.at(x, y);
      const int kind = (x / 24 + y / 9) % 5;
      if (kind == 0) p = static_cast<std::uint8_t>(100 + p % 9);
      if (kind == 1) p = p < 128 ? 0 : 255;
      if (kind == 2)
        p = ((x / 5) ^ (y / 4)) % 3 == 0 ? 200 : static_cast<std::uint8_t>(60 + p % 30);
    }
  }
  return image;
}

class Variants : public testing::TestWithParam<const Kernels*> {};

TEST_P(Variants, ScoreIsTheLargestThresholdAtEveryPixel) {
  const Kernels& k = *GetParam();
  for (const int width : {8, 41, 70, 71, 135, 200}) {
    const GrayImage image = mixed_image(width, 40, static_cast<std::uint32_t>(width));
    for (const int least : {1, 7, 20, 200}) {
      const int count = width - 6;
      const auto groups = static_cast<std::size_t>((count + 63) / 64);
      std::vector<std::uint8_t> score(groups * 64, 77);
      std::vector<std::uint8_t> any(groups, 77);
      for (int y = 3; y < image.height() - 3; ++y) {
        k.fast_score(image.row(y) + 3, width, count, least, score.data(), any.data());
        for (std::size_t i = 0; i < score.size(); ++i) {
          const int x = static_cast<int>(i) + 3;
          const int expected = x < width - 3 ? reference_score(image, x, y, least) : 0;
          ASSERT_EQ(score[i], expected) << "x " << x << " y " << y << " width " << width;
          ASSERT_TRUE(expected == 0 || any[i / 64] != 0);
        }
      }
    }
  }
}

TEST_P(Variants, MasksScoresFromAThresholdOn) {
  const GrayImage scores = test::noise_image(kernels::kScoreGroup, 1, 9);
  for (const int threshold : {0, 1, 20, 128, 255}) {
    const std::uint64_t mask = GetParam()->at_least(scores.row(0), threshold);
    for (int i = 0; i < kernels::kScoreGroup; ++i) {
      EXPECT_EQ(mask >> i & 1, scores.at(i, 0) >= threshold ? 1u : 0u) << i << " " << threshold;
    }
  }
}

TEST_P(Variants, SuppressionKeepsOnePeakOfNeighbours) {
  const GrayImage scores = test::noise_image(66, 60, 5, 4);  // few values: many ties
  for (int y = 1; y + 1 < scores.height(); ++y) {
    const std::uint64_t peaks =
        GetParam()->suppress(scores.row(y - 1) + 1, scores.row(y) + 1, scores.row(y + 1) + 1);
    for (int i = 0; i < 64; ++i) {
      const int s = scores.at(i + 1, y);
      bool peak = true;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          if (dx == 0 && dy == 0) continue;
          const bool earlier = dy < 0 || (dy == 0 && dx < 0);
          const int other = scores.at(i + 1 + dx, y + dy);
          peak = peak && (earlier ? s > other : s >= other);
        }
      }
      ASSERT_EQ((peaks >> i & 1) != 0, peak) << i << ' ' << y;
    }
  }
}

TEST_P(Variants, ReductionIsTheFormula) {
  const Kernels& k = *GetParam();
  const GrayImage row = test::noise_image(40, 1, 3);
  std::array<kernels::ResizeGroup, 2> groups{};
  const std::array<std::int32_t, 2> first{3, 24};
  std::mt19937 random(4);
  for (auto& group : groups) {
    for (std::size_t i = 0; i < 16; i += 2) {
      group.tap[i] = static_cast<std::uint8_t>(random() % 15);
      group.tap[i + 1] = static_cast<std::uint8_t>(group.tap[i] + 1);
      group.weight[i] = static_cast<std::uint8_t>(1 + random() % 255);
      group.weight[i + 1] = static_cast<std::uint8_t>(256 - group.weight[i]);
    }
  }
  std::array<std::int16_t, 16> out{};
  k.resize_row(row.data(), first.data(), groups.data(), 2, out.data());
  for (std::size_t i = 0; i < 16; ++i) {
    const auto& g = groups[i / 8];
    const std::size_t t = 2 * (i % 8);
    const auto at = static_cast<std::size_t>(first[i / 8]);
    const double value = (row.data()[at + g.tap[t]] * g.weight[t] +
                          row.data()[at + g.tap[t + 1]] * g.weight[t + 1]) /
                         256.0;
    EXPECT_NEAR(out[i] / 128.0 + 128, value, 1 / 128.0);
  }
}

TEST_P(Variants, RowsBlendAcrossTheWholeRange) {
  std::vector<std::int16_t> upper;
  std::vector<std::int16_t> lower;
  for (int a = 0; a < 256; a += 5) {
    for (int b = 0; b < 256; b += 3) {
      upper.push_back(static_cast<std::int16_t>((a - 128) * 128));
      lower.push_back(static_cast<std::int16_t>((b - 128) * 128));
    }
  }
  std::vector<std::uint8_t> out(upper.size());
  for (const int weight : {0, 1, 9000, 16384, 32767}) {
    GetParam()->blend_rows(upper.data(), lower.data(), weight, static_cast<int>(out.size()),
                           out.data());
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double w = weight / 32768.0;
      const double value = (upper[i] * (1 - w) + lower[i] * w) / 128 + 128;
      ASSERT_NEAR(out[i], value, 0.52) << value;
    }
  }
}

TEST_P(Variants, BlurIsAGaussian) {
  std::array<double, 7> w{};
  double sum = 0;
  for (std::size_t i = 0; i < 7; ++i) {
    w[i] = std::exp(-std::pow(static_cast<double>(i) - 3, 2) / 8);
    sum += w[i];
  }
  for (const int width : {1, 5, 37, 130}) {
    const GrayImage image = mixed_image(width, 7, 9);
    std::array<const std::uint8_t*, 7> rows{};
    for (int y = 0; y < 7; ++y) rows[static_cast<std::size_t>(y)] = image.row(y);
    std::vector<std::uint16_t> scratch(static_cast<std::size_t>(width) + 6);
    std::vector<std::uint8_t> out(static_cast<std::size_t>(width));
    GetParam()->blur_row(rows.data(), width, scratch.data(), out.data());
    for (int x = 0; x < width; ++x) {
      double value = 0;
      for (int dy = 0; dy < 7; ++dy) {
        for (int dx = 0; dx < 7; ++dx) {
          value += w[static_cast<std::size_t>(dx)] * w[static_cast<std::size_t>(dy)] *
                   image.at(std::clamp(x + dx - 3, 0, width - 1), dy) / (sum * sum);
        }
      }
      EXPECT_NEAR(out[static_cast<std::size_t>(x)], value, 1.6) << x;
    }
  }
}

TEST_P(Variants, MomentsSumOverTheDisc) {
  for (const bool extreme : {false, true}) {
    GrayImage image = test::noise_image(40, 40, 11);
    if (extreme) {  // the largest sums that can occur
      for (int y = 0; y < 40; ++y) {
        for (int x = 0; x < 40; ++x) image.at(x, y) = y > 18 ? 255 : 0;
      }
    }
    int m10 = 0;
    int m01 = 0;
    for (int v = -15; v <= 15; ++v) {
      const int reach = static_cast<int>(std::floor(std::sqrt(240.25 - v * v)));
      for (int u = -reach; u <= reach; ++u) {
        m10 += u * image.at(18 + u, 18 + v);
        m01 += v * image.at(18 + u, 18 + v);
      }
    }
    const kernels::Moments m = GetParam()->moments(image.row(18) + 18, image.width());
    EXPECT_EQ(m.m10, m10);
    EXPECT_EQ(m.m01, m01);
  }
}

TEST_P(Variants, DescriptorComparesTheTurnedPoints) {
  const GrayImage image = test::noise_image(64, 64, 13);
  std::array<float, 512> x{};
  std::array<float, 512> y{};
  for (std::size_t i = 0; i < 512; ++i) {
    x[i] = kOrbPattern[i % 256][i / 256][0];
    y[i] = kOrbPattern[i % 256][i / 256][1];
  }
  for (int turn = 0; turn < 360; turn += 7) {
    const float c = std::cos(static_cast<float>(turn) * 0.0174533f);
    const float s = std::sin(static_cast<float>(turn) * 0.0174533f);
    std::array<std::uint64_t, 4> words{};
    GetParam()->describe(image.row(32) + 32, 64, x.data(), y.data(), c, s, words.data());
    const auto at = [&](std::size_t i) {
      const float u = x[i] * c - y[i] * s;
      const float v = x[i] * s + y[i] * c;
      return image.at(32 + static_cast<int>(std::floor(u + 0.5f)),
                      32 + static_cast<int>(std::floor(v + 0.5f)));
    };
    int wrong = 0;
    for (std::size_t i = 0; i < 256; ++i) {
      wrong += (words[i / 64] >> (i % 64) & 1) != (at(i) < at(256 + i) ? 1u : 0u);
    }
    EXPECT_LE(wrong, 1) << turn;  // a point may lie half way between two pixels
    std::array<std::uint64_t, 4> plain{};
    kernels::available_kernels()[0]->describe(image.row(32) + 32, 64, x.data(), y.data(), c, s,
                                              plain.data());
    EXPECT_EQ(words, plain);
  }
}

/// Every loop on the same input, into one hash-free byte string, to compare variants bit by bit.
std::vector<std::uint8_t> fingerprint(const Kernels& k) {
  std::vector<std::uint8_t> bytes;
  const GrayImage image = mixed_image(160, 16, 21);
  std::array<const std::uint8_t*, 7> rows{};
  for (int y = 0; y < 7; ++y) rows[static_cast<std::size_t>(y)] = image.row(y);
  std::vector<std::uint16_t> scratch(166);
  std::vector<std::uint8_t> out(160);
  k.blur_row(rows.data(), 160, scratch.data(), out.data());
  bytes.insert(bytes.end(), out.begin(), out.end());
  std::vector<std::int16_t> wide[2] = {std::vector<std::int16_t>(160),
                                       std::vector<std::int16_t>(160)};
  std::vector<kernels::ResizeGroup> groups(20);
  std::vector<std::int32_t> first(20);
  for (std::size_t g = 0; g < 20; ++g) {
    first[g] = static_cast<std::int32_t>(7 * g);
    for (std::size_t i = 0; i < 16; ++i) {
      groups[g].tap[i] = static_cast<std::uint8_t>((i * 5 + g) % 16);
      groups[g].weight[i] = static_cast<std::uint8_t>(i % 2 == 0 ? 1 + g * 12 : 255 - g * 12);
    }
  }
  for (int r = 0; r < 2; ++r) {
    k.resize_row(image.row(r), first.data(), groups.data(), 20, wide[r].data());
  }
  k.blend_rows(wide[0].data(), wide[1].data(), 12345, 160, out.data());
  bytes.insert(bytes.end(), out.begin(), out.end());
  return bytes;
}

TEST_P(Variants, GivesTheBytesOfThePlainOne) {
  EXPECT_EQ(fingerprint(*GetParam()), fingerprint(*kernels::available_kernels()[0]));
}

INSTANTIATE_TEST_SUITE_P(Kernels, Variants,
                         testing::ValuesIn(kernels::available_kernels().begin(),
                                           kernels::available_kernels().end()),
                         [](const auto& variant) { return std::string(variant.param->name); });

}  // namespace
}  // namespace kys_slam
