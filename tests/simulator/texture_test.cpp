// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/texture.h"

#include <gtest/gtest.h>

#include "simulator/common/rng.h"
#include "simulator/shapes/canvas.h"

namespace kys_slam::simulator {
namespace {

TEST(Texture, TexelCentresAreReproducedAndTheTileRepeats) {
  std::vector<float> a(16);
  for (std::size_t i = 0; i < a.size(); ++i) a[i] = static_cast<float>(i) / 16.0F;
  const Texture t(4, a);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 4; ++x) {
      const float u = (static_cast<float>(x) + 0.5F) / 4;
      const float v = (static_cast<float>(y) + 0.5F) / 4;
      const float expected = a[static_cast<std::size_t>(4 * y + x)];
      EXPECT_NEAR(t.sample(u, v, 0.01F, 0, 0, 0.01F, 4), expected, 0.003F);
      EXPECT_NEAR(t.sample(u - 3, v + 5, 0.01F, 0, 0, 0.01F, 4), expected, 0.003F);
    }
  }
}

TEST(Texture, WideFootprintGivesTheMean) {
  Rng rng(3);
  std::vector<float> a(64 * 64);
  double mean = 0;
  for (float& x : a) {
    x = static_cast<float>(rng.uniform());
    mean += x / static_cast<double>(a.size());
  }
  const Texture t(64, a);
  EXPECT_NEAR(t.sample(0.3F, 0.7F, 1.0F, 0, 0, 1.0F, 4), mean, 0.01);
  EXPECT_NEAR(t.sample(0.3F, 0.7F, 40.0F, 0, 0, 40.0F, 4), mean, 0.01);
}

TEST(Texture, StripesVanishAcrossButNotAlongThem) {
  // Vertical stripes of 4 texels: a footprint long in v keeps them, one long in u does not.
  std::vector<float> a(64 * 64);
  for (std::size_t i = 0; i < a.size(); ++i) a[i] = (i % 64) / 4 % 2 == 0 ? 0.9F : 0.1F;
  const Texture t(64, a);
  const float pixel = 1.0F / 64;
  const float along_bright = t.sample(1.5F / 64, 0.5F, pixel, 0, 0, 8 * pixel, 8);
  const float along_dark = t.sample(5.5F / 64, 0.5F, pixel, 0, 0, 8 * pixel, 8);
  EXPECT_GT(along_bright - along_dark, 0.7F);
  const float across_bright = t.sample(1.5F / 64, 0.5F, 8 * pixel, 0, 0, pixel, 8);
  const float across_dark = t.sample(5.5F / 64, 0.5F, 8 * pixel, 0, 0, pixel, 8);
  EXPECT_LT(std::abs(across_bright - across_dark), 0.1F);
}

TEST(Rng, NormalDeviatesHaveTheirMoments) {
  Rng rng(11);
  double sum = 0;
  double square = 0;
  constexpr int kCount = 200000;
  for (int i = 0; i < kCount; ++i) {
    const double x = rng.gaussian();
    sum += x;
    square += x * x;
  }
  EXPECT_NEAR(sum / kCount, 0, 0.01);
  EXPECT_NEAR(square / kCount, 1, 0.015);
  EXPECT_NEAR(inverse_normal(0.975), 1.959963985, 1e-6);
}

}  // namespace
}  // namespace kys_slam::simulator
