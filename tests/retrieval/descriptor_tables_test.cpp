// SPDX-License-Identifier: BSD-3-Clause
#include "retrieval/descriptor_tables.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "place_fixtures.h"

namespace kys_slam {
namespace {

using testing::random_descriptor;
using testing::with_flips;

TEST(ListPool, ListsKeepTheirNumbersWhileOthersGrowAndShrink) {
  ListPool pool;
  std::mt19937_64 random(1);
  std::vector<ListPool::List> lists(300);
  std::vector<std::vector<std::uint32_t>> expected(lists.size());
  for (int step = 0; step < 60000; ++step) {
    // Few lists get most of the numbers, so that there are long ones.
    const std::size_t l = (random() % lists.size()) * (random() % lists.size()) / lists.size();
    if (random() % 3 != 0) {
      const auto value = static_cast<std::uint32_t>(step);
      pool.push(lists[l], value);
      expected[l].push_back(value);
    } else if (!expected[l].empty()) {
      const std::size_t victim = random() % expected[l].size();
      EXPECT_TRUE(pool.remove(lists[l], expected[l][victim]));
      expected[l].erase(expected[l].begin() + static_cast<std::ptrdiff_t>(victim));
    }
  }
  for (std::size_t l = 0; l < lists.size(); ++l) {
    const auto view = pool.view(lists[l]);
    std::vector<std::uint32_t> found(view.begin(), view.end());
    std::sort(found.begin(), found.end());
    std::sort(expected[l].begin(), expected[l].end());
    EXPECT_EQ(found, expected[l]);
  }
}

TEST(ListPool, BlocksAreUsedAgain) {
  ListPool pool;
  std::vector<ListPool::List> lists(1000);
  const auto fill_and_empty = [&] {
    for (std::uint32_t v = 0; v < 50; ++v) {
      for (auto& list : lists) pool.push(list, v);
    }
    for (auto& list : lists) pool.clear(list);
  };
  fill_and_empty();
  const std::size_t bytes = pool.bytes();
  for (int i = 0; i < 20; ++i) fill_and_empty();
  EXPECT_EQ(pool.bytes(), bytes);
}

TEST(ListPool, ANumberThatIsNotThereIsNotRemoved) {
  ListPool pool;
  ListPool::List list;
  EXPECT_FALSE(pool.remove(list, 7));
  pool.push(list, 7);
  EXPECT_FALSE(pool.remove(list, 8));
  EXPECT_TRUE(pool.remove(list, 7));
  EXPECT_TRUE(pool.view(list).empty());
}

TEST(DescriptorTables, FindWithTheProbabilityOfTheTextbook) {
  // 1 - (1 - p)^8, p the chance that none of 16 bits is among the r of 256 that differ.
  DescriptorTables tables(8, 0);
  std::mt19937_64 random(5);
  std::vector<kys::Descriptor> filed;
  for (std::uint32_t i = 0; i < 4000; ++i) {
    filed.push_back(random_descriptor(random));
    tables.insert(filed.back(), i);
  }
  for (const int flips : {0, 10, 20, 30, 50}) {
    double found = 0;
    for (std::uint32_t i = 0; i < filed.size(); ++i) {
      const kys::Descriptor noisy = with_flips(filed[i], flips, random);
      bool any = false;
      for (int t = 0; t < tables.tables(); ++t) {
        const auto bucket = tables.bucket(tables.key(noisy, t));
        any = any || std::find(bucket.begin(), bucket.end(), i) != bucket.end();
      }
      found += any ? 1 : 0;
    }
    double p = 1;
    for (int k = 0; k < 16; ++k) p *= (256.0 - flips - k) / (256.0 - k);
    EXPECT_NEAR(found / static_cast<double>(filed.size()), 1 - std::pow(1 - p, 8), 0.03) << flips;
  }
}

TEST(DescriptorTables, SixteenTablesUseEveryBitOnce) {
  const DescriptorTables tables(DescriptorTables::kMaxTables, 3);
  for (std::size_t bit = 0; bit < 256; ++bit) {
    kys::Descriptor d;
    d.words[bit / 64] = std::uint64_t{1} << (bit % 64);
    int changed = 0;
    for (int t = 0; t < tables.tables(); ++t) changed += tables.key(d, t) != tables.key({}, t);
    EXPECT_EQ(changed, 1) << bit;
  }
}

TEST(DescriptorTables, TheSeedChoosesTheBits) {
  std::mt19937_64 random(8);
  const kys::Descriptor d = random_descriptor(random);
  EXPECT_EQ(DescriptorTables(8, 1).key(d, 3), DescriptorTables(8, 1).key(d, 3));
  EXPECT_NE(DescriptorTables(8, 1).key(d, 3), DescriptorTables(8, 2).key(d, 3));
}

TEST(DescriptorTables, WhatIsNotThereCannotBeErased) {
  DescriptorTables tables(2, 0);
  std::mt19937_64 random(9);
  EXPECT_THROW(tables.erase(random_descriptor(random), 0), std::logic_error);
  EXPECT_THROW(DescriptorTables(0, 0), std::invalid_argument);
  EXPECT_THROW(DescriptorTables(17, 0), std::invalid_argument);
}

}  // namespace
}  // namespace kys_slam
