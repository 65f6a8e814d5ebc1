// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_kernels.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace kys_slam {
namespace {

constexpr int kParameters = 17;
constexpr std::size_t kSize = rig::padded(kParameters);  // 20
constexpr int kCount = static_cast<int>(kSize) / kLanes;

/// Numbers without order, whose sums are rounded.
std::vector<double> numbers(std::size_t count, double seed) {
  std::vector<double> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = std::sin(seed + 1.7 * static_cast<double>(i));
  return values;
}

// Sums in the order of the rows, each product rounded: the same bytes for every instruction set.

TEST(RigKernels, SquaresAreTheTextbookSums) {
  constexpr std::size_t kRows = 7;
  const std::vector<double> J = numbers(kRows * kSize, 1), weighted = numbers(kRows * kSize, 2);
  std::vector<double> H = numbers(kSize * kSize, 3);
  const std::vector<double> before = H;
  rig::add_squares(J.data(), weighted.data(), kRows, kCount, H.data());
  for (std::size_t c = 0; c < kSize; ++c) {
    for (std::size_t r = c; r < kSize; ++r) {
      double sum = before[kSize * c + r];
      for (std::size_t row = 0; row < kRows; ++row) {
        sum += J[kSize * row + r] * weighted[kSize * row + c];
      }
      EXPECT_EQ(H[kSize * c + r], sum) << r << " " << c;
    }
  }
}

TEST(RigKernels, RowsAndProductsAreTheTextbookSums) {
  constexpr std::size_t kRows = 3;
  const std::vector<double> rows = numbers(kRows * kSize, 4), factors = numbers(kRows * 6, 5);
  std::vector<double> b = numbers(kSize, 6), mixed = numbers(6 * kSize, 7);
  const std::vector<double> b_before = b, mixed_before = mixed;
  rig::add_rows(rows.data(), factors.data(), kRows, kCount, b.data());
  rig::add_products(rows.data(), factors.data(), kRows, kCount, mixed.data());
  for (std::size_t k = 0; k < kSize; ++k) {
    double sum = b_before[k];
    for (std::size_t row = 0; row < kRows; ++row) sum += rows[kSize * row + k] * factors[row];
    EXPECT_EQ(b[k], sum);
    for (std::size_t c = 0; c < 6; ++c) {
      sum = mixed_before[kSize * c + k];
      for (std::size_t row = 0; row < kRows; ++row) {
        sum += rows[kSize * row + k] * factors[6 * row + c];
      }
      EXPECT_EQ(mixed[kSize * c + k], sum);
    }
  }
}

TEST(RigKernels, PairsFillTheLowerTriangleOfFreePoses) {
  constexpr std::ptrdiff_t kStride = 13;  // columns at any multiple of 8 bytes
  const std::vector<std::int32_t> place{6, -1, 0};
  const std::vector<double> Z = numbers(3 * 18, 8);
  std::vector<double> H(kStride * kStride, 0.0);
  rig::subtract_pairs(place.data(), Z.data(), place.size(), kStride, H.data());
  const auto product = [&](std::size_t a, std::size_t c, std::size_t r, std::size_t s) {
    double sum = 0;
    for (std::size_t row = 0; row < 3; ++row) {
      sum += Z[18 * a + 6 * row + r] * Z[18 * c + 6 * row + s];
    }
    return sum;
  };
  for (std::size_t r = 0; r < 6; ++r) {
    for (std::size_t s = 0; s < 6; ++s) {
      EXPECT_EQ(H[13 * s + r], -product(2, 2, r, s));
      EXPECT_EQ(H[13 * s + 6 + r], -product(0, 2, r, s));
      EXPECT_EQ(H[13 * (6 + s) + 6 + r], -product(0, 0, r, s));
      EXPECT_EQ(H[13 * (6 + s) + r], 0);  // above the diagonal
    }
  }
}

}  // namespace
}  // namespace kys_slam
