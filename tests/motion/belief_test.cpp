// SPDX-License-Identifier: BSD-3-Clause
#include "motion/belief.h"

#include <gtest/gtest.h>

namespace kys_slam {
namespace {

TEST(Belief, SettlesWhereTheFilePutsIt) {
  BeliefUpdateOptions options;
  options.change_rate = 0.5;
  // Half a second of a chain of two states, by hand: s = 1 - exp(-0.25), p' = p + s (p0 - p).
  const double p = probability(-3.0);
  const double share = 1 - std::exp(-0.25);
  const double expected = p + share * (probability(1.0) - p);
  EXPECT_NEAR(probability(after_time(-3.0, 1.0, 0.5, options)), expected, 1e-12);
  EXPECT_NEAR(after_time(-3.0, 1.0, 1e3, options), 1.0, 1e-9);
  EXPECT_EQ(after_time(2.0, 2.0, 5, options), after_time(2.0, 2.0, 50, options));
  EXPECT_NEAR(after_time(-3.0, 1.0, 0, options), -3.0, 1e-9);
}

TEST(Belief, OneFrameSaysOnlySoMuch) {
  BeliefUpdateOptions options;
  options.max_evidence = 3;
  options.max_log_odds = 7;
  EXPECT_DOUBLE_EQ(after_evidence(1, -0.5, options), 0.5);
  EXPECT_DOUBLE_EQ(after_evidence(1, -500, options), -2);
  EXPECT_DOUBLE_EQ(after_evidence(6, 500, options), 7);
}

}  // namespace
}  // namespace kys_slam
