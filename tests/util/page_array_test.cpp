// SPDX-License-Identifier: BSD-3-Clause
#include "util/page_array.h"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <utility>

namespace kys_slam {
namespace {

using Block = std::array<double, 36>;  // no divisor of a page

TEST(PageArray, ReleasesNothingButWhatItIsAskedTo) {
  constexpr std::size_t kSize = 5000;
  PageArray<Block> before(kSize), array(kSize), after(kSize);
  for (PageArray<Block>* a : {&before, &array, &after}) {
    for (std::size_t i = 0; i < kSize; ++i) a->data()[i].fill(static_cast<double>(i));
  }
  array.release(1000, 3000);
  array.release(4000, kSize);
  array.release(7, 8);  // less than a page
  for (std::size_t i = 0; i < kSize; ++i) {
    ASSERT_EQ(before.data()[i].back(), static_cast<double>(i));
    ASSERT_EQ(after.data()[i].front(), static_cast<double>(i));
    if ((i >= 1000 && i < 3000) || i >= 4000) continue;
    ASSERT_EQ(array.data()[i].front(), static_cast<double>(i));
    ASSERT_EQ(array.data()[i].back(), static_cast<double>(i));
  }
  for (std::size_t i = 0; i < kSize; ++i) array.data()[i].fill(1);  // usable again
  double sum = 0;
  for (std::size_t i = 0; i < kSize; ++i) sum += array.data()[i][17];
  EXPECT_EQ(sum, static_cast<double>(kSize));
}

TEST(PageArray, MayBeEmptyAndMoves) {
  PageArray<int> empty, none(0);
  empty.release(0, 0);
  none.release(0, 0);
  EXPECT_EQ(none.size(), 0u);
  PageArray<int> from(3);
  from.data()[2] = 5;
  empty = std::move(from);
  EXPECT_EQ(empty.size(), 3u);
  EXPECT_EQ(empty.data()[2], 5);
}

}  // namespace
}  // namespace kys_slam
