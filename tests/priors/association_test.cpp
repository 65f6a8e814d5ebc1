// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/association.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

namespace kys_slam {
namespace {

using Ids = std::vector<std::int32_t>;

InstanceAssociator make(bool class_agnostic = false) {
  BuilderOptions::Association options;
  options.class_agnostic = class_agnostic;
  return InstanceAssociator(options);
}

std::vector<Detection> at(std::initializer_list<Detection> list) {
  return list;
}

TEST(Association, KeepsIdentitiesWhateverTheOrder) {
  auto tracker = make();
  EXPECT_EQ(tracker.next_frame(at({{2, 100, 100}, {2, 300, 100}})), (Ids{0, 1}));
  EXPECT_EQ(tracker.next_frame(at({{2, 305, 100}, {2, 110, 100}})), (Ids{1, 0}));
}

TEST(Association, MinimisesTheTotalAndNotTheFirst) {
  auto tracker = make();
  tracker.next_frame(at({{2, 0, 0}, {2, 40, 0}}));
  // Greedy would give the first detection (30) to track 1 (10 px) and leave 90 for track 0;
  // the totals are 30 + 50 = 80 against 10 + 90 = 100.
  EXPECT_EQ(tracker.next_frame(at({{2, 30, 0}, {2, 90, 0}})), (Ids{0, 1}));
}

TEST(Association, FollowsACrossing) {
  auto tracker = make();
  tracker.next_frame(at({{2, 100, 100}, {2, 200, 130}}));
  for (int step = 1; step <= 9; ++step) {
    // They pass each other with 30 px between their rows, 10 px per frame.
    const Ids ids =
        tracker.next_frame(at({{2, 100.0 + 10 * step, 100}, {2, 200.0 - 10 * step, 130}}));
    EXPECT_EQ(ids, (Ids{0, 1})) << step;
  }
}

TEST(Association, PairsOverTheLimitAreRejected) {
  auto tracker = make();
  tracker.next_frame(at({{2, 0, 0}}));
  EXPECT_EQ(tracker.next_frame(at({{2, 100, 0}})), (Ids{0}));
  EXPECT_EQ(tracker.next_frame(at({{2, 200.01, 0}})), (Ids{1}));
}

TEST(Association, SurvivesAGapOfFiveFramesAndNotOfSix) {
  for (const int gap : {5, 6}) {
    auto tracker = make();
    tracker.next_frame(at({{2, 50, 50}}));
    for (int i = 0; i < gap; ++i) tracker.next_frame({});
    EXPECT_EQ(tracker.next_frame(at({{2, 52, 50}})), (gap == 5 ? Ids{0} : Ids{1})) << gap;
  }
}

TEST(Association, IsWithinAClassUnlessAskedOtherwise) {
  auto tracker = make();
  tracker.next_frame(at({{2, 50, 50}}));
  EXPECT_EQ(tracker.next_frame(at({{7, 50, 50}})), (Ids{1}));
  auto agnostic = make(true);
  agnostic.next_frame(at({{2, 50, 50}}));
  EXPECT_EQ(agnostic.next_frame(at({{7, 50, 50}})), (Ids{0}));
}

TEST(Association, MoreDetectionsThanTracksAndTheOtherWayRound) {
  auto tracker = make();
  EXPECT_EQ(tracker.next_frame(at({{2, 0, 0}, {2, 50, 0}, {2, 99, 0}})), (Ids{0, 1, 2}));
  EXPECT_EQ(tracker.next_frame(at({{2, 52, 0}})), (Ids{1}));
  EXPECT_EQ(tracker.next_frame(at({{2, 0, 0}, {2, 20, 0}, {2, 54, 0}, {2, 99, 0}})),
            (Ids{0, 3, 1, 2}));
}

TEST(Association, MoreThingsThanCanBeAssignedAreRefused) {
  std::vector<Detection> many(2049, Detection{2, 0, 0});
  auto tracker = make();
  tracker.next_frame(at({{2, 0, 0}}));
  EXPECT_THROW(tracker.next_frame(many), InputError);
  for (std::size_t i = 0; i < 1024; ++i) many[i].label = 3;
  EXPECT_NO_THROW(tracker.next_frame(many)) << "of two classes";
}

}  // namespace
}  // namespace kys_slam
