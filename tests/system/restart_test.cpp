// SPDX-License-Identifier: BSD-3-Clause
#include "system/restart.h"

#include <gtest/gtest.h>

namespace kys_slam {
namespace {

constexpr int kPatience = 5;

/// Frames lost until one of them starts a sub-map.
int lost_until_due(Restart& restart, bool refused) {
  for (int frame = 1; frame <= 100; ++frame) {
    if (restart.is_due(refused)) return frame;
  }
  return -1;
}

TEST(Restart, ACameraThatIsElsewhereStartsAtOnce) {
  Restart restart(kPatience);
  EXPECT_FALSE(restart.is_provisional());
  EXPECT_EQ(lost_until_due(restart, false), 1);
}

TEST(Restart, APoseThatIsRefusedIsWaitedFor) {
  Restart restart(kPatience);
  EXPECT_EQ(lost_until_due(restart, true), kPatience);
  restart.tracked(false);
  EXPECT_EQ(lost_until_due(restart, true), kPatience) << "counted anew after a frame with a pose";
}

TEST(Restart, ASubmapIsProvisionalForItsFirstFrames) {
  Restart restart(kPatience);
  restart.started();
  for (int frame = 0; frame < kPatience; ++frame) {
    EXPECT_TRUE(restart.is_provisional()) << frame;
    restart.tracked(false);
  }
  EXPECT_FALSE(restart.is_provisional());
}

TEST(Restart, TheMapBeforeEndsIt) {
  Restart restart(kPatience);
  restart.started();
  restart.tracked(true);
  EXPECT_FALSE(restart.is_provisional());
  EXPECT_EQ(lost_until_due(restart, false), 1);
}

TEST(Restart, AProvisionalSubmapThatIsLostStartsNoOtherAtOnce) {
  Restart restart(kPatience);
  restart.started();
  restart.tracked(false);
  EXPECT_EQ(lost_until_due(restart, false), kPatience);
  restart.started();
  for (int frame = 0; frame < kPatience; ++frame) restart.tracked(false);
  EXPECT_EQ(lost_until_due(restart, false), 1) << "this one has lasted";
}

}  // namespace
}  // namespace kys_slam
