// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/local_map.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::kf;
using testing::lm;

/// Keyframes 0..9; landmark i is seen by keyframes i and i+1; neighbours, parent and children as in
/// a chain.
Replica chain() {
  Replica replica;
  for (std::uint32_t k = 0; k < 10; ++k) {
    KeyFrameView view;
    if (k > 0) view.landmarks.push_back(lm(k - 1));
    view.landmarks.push_back(LandmarkId{});
    if (k < 9) view.landmarks.push_back(lm(k));
    if (k > 0) view.parent = kf(k - 1);
    if (k < 9) view.children = {kf(k + 1)};
    replica.put(kf(k), view);
    if (k < 9) {
      LandmarkView landmark;
      landmark.observers = {kf(k), kf(k + 1)};
      replica.put(lm(k), landmark);
    }
  }
  return replica;
}

bool contains(const std::vector<KeyFrameId>& ids, std::uint32_t id) {
  return std::find(ids.begin(), ids.end(), kf(id)) != ids.end();
}

TEST(LocalMap, HoldsThoseThatSeeTheLandmarksAndTheirRelatives) {
  const Replica replica = chain();
  LocalMapGatherer gatherer;
  const std::vector<LandmarkId> frame{lm(4), LandmarkId{}, lm(5)};
  const LocalMap local = gatherer.gather(replica, frame);
  EXPECT_EQ(local.reference, kf(5)) << "sees both landmarks";
  for (const std::uint32_t k : {4u, 5u, 6u}) EXPECT_TRUE(contains(local.keyframes, k)) << k;
  EXPECT_TRUE(contains(local.keyframes, 3)) << "parent of 4";
  EXPECT_TRUE(contains(local.keyframes, 7)) << "child of 6";
  EXPECT_EQ(local.keyframes.size(), 5u);
  std::vector<LandmarkId> landmarks = local.landmarks;
  std::sort(landmarks.begin(), landmarks.end());
  EXPECT_EQ(landmarks, (std::vector<LandmarkId>{lm(2), lm(3), lm(4), lm(5), lm(6), lm(7)}))
      << "each once";
}

TEST(LocalMap, OfEqualReferencesTheYoungerIsTaken) {
  const Replica replica = chain();
  const std::vector<LandmarkId> frame{lm(4)};
  EXPECT_EQ(LocalMapGatherer().gather(replica, frame).reference, kf(5));
}

TEST(LocalMap, IsEmptyWhenNothingSeesTheFramesLandmarks) {
  const Replica replica = chain();
  LocalMapGatherer gatherer;
  for (const auto& frame : {std::vector<LandmarkId>{}, std::vector<LandmarkId>{LandmarkId{}},
                            std::vector<LandmarkId>{lm(77)}}) {
    const LocalMap local = gatherer.gather(replica, frame);
    EXPECT_TRUE(local.keyframes.empty());
    EXPECT_TRUE(local.landmarks.empty());
    EXPECT_FALSE(local.reference.valid());
  }
}

TEST(LocalMap, ForgetsTheCallBefore) {
  const Replica replica = chain();
  LocalMapGatherer gatherer;
  const std::vector<LandmarkId> here{lm(1)};
  const std::vector<LandmarkId> there{lm(7)};
  const LocalMap first = gatherer.gather(replica, here);
  (void)gatherer.gather(replica, there);
  const LocalMap again = gatherer.gather(replica, here);
  EXPECT_EQ(first.keyframes, again.keyframes);
  EXPECT_EQ(first.landmarks, again.landmarks);
  EXPECT_EQ(first.reference, again.reference);
}

TEST(LocalMap, RelativesStopAtTheLimit) {
  const Replica replica = chain();
  LocalMapGatherer gatherer(2);
  const std::vector<LandmarkId> frame{lm(4), lm(5)};
  const LocalMap local = gatherer.gather(replica, frame);
  EXPECT_EQ(local.keyframes.size(), 3u) << "those that see the landmarks are in, nobody else";
}

TEST(LocalMap, ObserversTheReplicaDoesNotHaveAreIgnored) {
  Replica replica = chain();
  LandmarkView landmark;
  landmark.observers = {kf(3), kf(55)};
  replica.put(lm(20), landmark);
  const std::vector<LandmarkId> frame{lm(20)};
  EXPECT_EQ(LocalMapGatherer().gather(replica, frame).reference, kf(3));
}

}  // namespace
}  // namespace kys_slam
