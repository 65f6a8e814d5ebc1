// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/visibility_counts.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <utility>

namespace kys_slam {
namespace {

TEST(VisibilityCounts, AreSumsByLandmarkHoweverManyFramesThereAre) {
  std::mt19937 random(3);
  VisibilityCounts counts;
  for (int keyframe = 0; keyframe < 3; ++keyframe) {
    std::map<LandmarkId, std::pair<std::uint32_t, std::uint32_t>> expected;
    for (int i = 0; i < 50000; ++i) {  // merged several times on the way
      const LandmarkId id{static_cast<std::uint32_t>(random() % 6000)};
      counts.add_visible(id);
      ++expected[id].first;
      if (random() % 3 == 0) {
        counts.add_found(id);
        ++expected[id].second;
      }
    }
    const std::vector<VisibilityCount> taken = counts.take();
    ASSERT_EQ(taken.size(), expected.size());
    auto next = expected.begin();
    for (const VisibilityCount& count : taken) {
      EXPECT_EQ(count.id, next->first);
      EXPECT_EQ(count.visible, next->second.first);
      EXPECT_EQ(count.found, next->second.second);
      ++next;
    }
    EXPECT_TRUE(counts.take().empty());
  }
}

}  // namespace
}  // namespace kys_slam
