// SPDX-License-Identifier: BSD-3-Clause
// The library compiled with KYS_PLAIN_POPCOUNT: every mode is the plain popcount.

#include <gtest/gtest.h>

#include "test_support.h"

namespace kys::test {
namespace {

int count_bits(const Descriptor& a, const Descriptor& b) {
  int bits = 0;
  for (int i = 0; i < 256; ++i) {
    bits += ((a.words[i / 64] ^ b.words[i / 64]) >> (i % 64)) & 1;
  }
  return bits;
}

TEST(PlainPopcount, EveryModeIsTheHammingDistance) {
  static_assert(kPriorsOff);
  RandomPairs random(21);
  for (const Mode mode : all_modes()) {
    const DistanceModel model(options_of(mode), three_classes());
    EXPECT_FALSE(model.uses_priors());
    for (int i = 0; i < 500; ++i) {
      const Descriptor a = random.descriptor();
      const Descriptor b = random.descriptor();
      const Prior pa = random.prior();
      const Prior pb = random.prior();
      const Context context = random.context();
      const Distance expected{static_cast<float>(count_bits(a, b)), Tier::kBypassed};
      ASSERT_EQ(model.evaluate(a, pa, b, pb, context), expected);
      ASSERT_EQ(model.evaluate(a, pa, b, pb, context, 1.0f), expected);
      ASSERT_EQ(model.modulate(count_bits(a, b), pa, pb, context), expected);
      ASSERT_TRUE(model.keeps_keypoint(pa));
      Statistics statistics;
      const std::uint32_t only = 0;
      const BestTwo best =
          model.best_two(a, pa, {&b, 1}, {&pb, 1}, {&only, 1}, context, statistics);
      ASSERT_EQ(best.best, expected);
      ASSERT_EQ(best.index, 0u);
    }
  }
}

}  // namespace
}  // namespace kys::test
