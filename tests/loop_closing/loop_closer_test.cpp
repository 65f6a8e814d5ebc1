// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/loop_closer.h"

#include <gtest/gtest.h>

#include <set>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::ring_pose;

constexpr int kLap = 84;  // keyframes in a round of 251 m

FeatureWorld ring(double noise = 0.3) {
  FeatureWorld::Options options;
  options.points = 9000;
  options.pixel_noise = noise;
  options.flipped_bits = 10;
  return testing::ring_world(options);
}

/// Drift of the estimate at keyframe k: it turns and shifts steadily.
Rigid3 drifted(const Rigid3& T_w_c, int k, double share_of_drift) {
  const double s = share_of_drift * k / kLap;
  const Rigid3 drift(so3_exp({0.002 * s, 0.01 * s, 0}),
                     Eigen::Vector3d(0.6 * s, 0.2 * s, -0.4 * s));
  return drift * T_w_c;
}

/// A map as odometry makes it: keyframes drift, each landmark stands where the first of its track
/// sees it, and a point seen again after the round is another landmark.
struct DriftedMap {
  Map map;
  PlaceIndex index;
  std::vector<Rigid3> truth;  // T_w_c
};

void add_range(DriftedMap& made, const FeatureWorld& world, int begin, int end, double drift,
               std::uint32_t& next_landmark, bool connect) {
  std::vector<LandmarkId> of_point(world.points().size());
  std::vector<std::vector<std::pair<int, std::uint32_t>>> views(world.points().size());
  std::vector<testing::SeenFeatures> seen;
  for (int k = begin; k < end; ++k) {
    seen.push_back(testing::see(world, k, made.truth[static_cast<std::size_t>(k)]));
    made.map.add_keyframe(testing::make_keyframe(
        static_cast<std::uint32_t>(k), seen.back().features,
        drifted(made.truth[static_cast<std::size_t>(k)], k, drift).inverse()));
    for (std::size_t f = 0; f < seen.back().points.size(); ++f) {
      views[seen.back().points[f]].emplace_back(k, static_cast<std::uint32_t>(f));
    }
  }
  for (std::size_t p = 0; p < views.size(); ++p) {
    // Tracks of at most ten keyframes: as far as a map of odometry ties things together.
    for (std::size_t first = 0; first < views[p].size();) {
      std::size_t last = first + 1;
      while (last < views[p].size() && views[p][last].first - views[p][first].first < 10) ++last;
      if (last - first >= 2) {
        const int k0 = views[p][first].first;
        const Rigid3 there = drifted(made.truth[static_cast<std::size_t>(k0)], k0, drift) *
                             made.truth[static_cast<std::size_t>(k0)].inverse();
        const LandmarkId id{next_landmark++};
        made.map.add_landmark(testing::make_landmark(id.value, there * world.points()[p].p_w,
                                                     KeyFrameId{static_cast<std::uint32_t>(k0)}));
        for (std::size_t v = first; v < last; ++v) {
          made.map.add_observation(id, KeyFrameId{static_cast<std::uint32_t>(views[p][v].first)},
                                   views[p][v].second);
        }
      }
      first = last;
    }
  }
  for (int k = begin + 1; k < end; ++k) {
    made.map.connect_to_spanning_tree(KeyFrameId{static_cast<std::uint32_t>(k)},
                                      KeyFrameId{static_cast<std::uint32_t>(k - 1)});
  }
  if (connect && begin > 0) {
    made.map.connect_to_spanning_tree(KeyFrameId{static_cast<std::uint32_t>(begin)},
                                      KeyFrameId{static_cast<std::uint32_t>(begin - 1)});
  }
  for (const LandmarkId id : made.map.landmarks().ids()) made.map.refresh_landmark(id);
  made.index.apply(made.map.take_changes());
}

DriftedMap round_trip(const FeatureWorld& world, int keyframes, double drift) {
  DriftedMap made{Map(world.camera(), ScaleLevels(1.2, 8)), PlaceIndex(), {}};
  for (int k = 0; k < keyframes; ++k) {
    made.truth.push_back(ring_pose(k * testing::ring_length() / kLap));
  }
  std::uint32_t next = 0;
  add_range(made, world, 0, keyframes, drift, next, true);
  return made;
}

/// Largest distance of a keyframe from the truth, both relative to the first, m.
double worst(const DriftedMap& made) {
  const Rigid3 T_0_w = made.map.keyframe(KeyFrameId{0}).T_c_w;
  double worst = 0;
  made.map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& k) {
    const Rigid3 estimate = T_0_w * k.T_c_w.inverse();
    const Rigid3 truth = made.truth[0].inverse() * made.truth[id.value];
    worst = std::max(worst, (estimate.t() - truth.t()).norm());
  });
  return worst;
}

class LoopCloserTest : public ::testing::Test {
 protected:
  LoopReport close(DriftedMap& made, std::uint32_t current, LoopOptions options = {}) {
    LoopCloser closer(options, LocalBundleOptions{}, model_);
    LoopReport report = closer.process(made.map, KeyFrameId{current}, made.index);
    made.map.check_consistency();
    return report;
  }
  kys::DistanceModel model_{kys::ModeOptions{}};
};

TEST_F(LoopCloserTest, TakesAwayTheDriftOfARoundTrip) {
  const FeatureWorld world = ring();
  DriftedMap made = round_trip(world, kLap + 6, 1);
  const double before = worst(made);
  ASSERT_GT(before, 0.7);
  const LoopReport report = close(made, kLap + 5);
  ASSERT_TRUE(report.closed);
  EXPECT_LE(report.closed->value, 8u);
  EXPECT_FALSE(report.merged);
  // The gap is the drift of a whole round: of keyframe 89 over that of keyframe 5.
  const Rigid3 expected =
      drifted(made.truth[kLap + 5], kLap + 5, 1) * drifted(made.truth[kLap + 5], 5, 1).inverse();
  EXPECT_NEAR(report.gap,
              (made.truth[kLap + 5].inverse() * expected * made.truth[kLap + 5]).t().norm(), 0.15);
  EXPECT_GT(report.fused, 50);
  EXPECT_LT(worst(made), 0.35 * before);
  // The two ends see the same landmarks now, and the essential graph knows.
  const auto near = made.map.best_covisible(KeyFrameId{kLap + 5}, 30, 15);
  EXPECT_TRUE(std::any_of(near.begin(), near.end(), [](KeyFrameId id) { return id.value < 12; }));
  EXPECT_EQ(made.map.keyframe(KeyFrameId{kLap + 5}).loop_edges,
            std::vector<KeyFrameId>{*report.closed});
}

TEST_F(LoopCloserTest, FindsNothingWhereNothingWasSeenBefore) {
  DriftedMap made = round_trip(ring(), kLap / 2, 1);
  EXPECT_FALSE(close(made, kLap / 2 - 1).closed);
}

TEST_F(LoopCloserTest, APathCannotBeWrongByMoreThanOdometryDrifts) {
  // The round is 250 m long and 0.7 m wrong at its end.
  DriftedMap made = round_trip(ring(), kLap + 6, 1);
  LoopOptions options;
  options.max_drift = 0.002;
  options.min_allowed_drift = 0.1;
  const LoopReport report = close(made, kLap + 5, options);
  EXPECT_GT(report.candidates, 0);
  EXPECT_FALSE(report.closed);
  options.min_allowed_drift = 1;
  EXPECT_TRUE(close(made, kLap + 5, options).closed);
  made = round_trip(ring(), kLap + 6, 1);
  options.max_drift = 0.01;
  options.min_allowed_drift = 0;
  EXPECT_TRUE(close(made, kLap + 5, options).closed) << "of its length";
}

TEST_F(LoopCloserTest, ANeighbourThatDoesNotConfirmIsNoLoop) {
  DriftedMap made = round_trip(ring(), kLap + 6, 1);
  LoopOptions options;
  options.min_confirming = 6;  // more than are asked
  EXPECT_FALSE(close(made, kLap + 5, options).closed);
}

TEST_F(LoopCloserTest, WaitsBetweenTwoLoops) {
  DriftedMap made = round_trip(ring(), kLap + 6, 1);
  LoopOptions options;
  LoopCloser closer(options, LocalBundleOptions{}, model_);
  ASSERT_TRUE(closer.process(made.map, KeyFrameId{kLap + 4}, made.index).closed);
  made.index.apply(made.map.take_changes());
  const LoopReport next = closer.process(made.map, KeyFrameId{kLap + 5}, made.index);
  EXPECT_FALSE(next.closed);
  EXPECT_EQ(next.candidates, 0);
}

TEST_F(LoopCloserTest, CanBeSwitchedOff) {
  DriftedMap made = round_trip(ring(), kLap + 6, 1);
  LoopOptions options;
  options.enabled = false;
  EXPECT_FALSE(close(made, kLap + 5, options).closed);
}

TEST_F(LoopCloserTest, IsTheSameEveryTime) {
  const FeatureWorld world = ring();
  DriftedMap a = round_trip(world, kLap + 6, 1);
  DriftedMap b = round_trip(world, kLap + 6, 1);
  close(a, kLap + 5);
  close(b, kLap + 5);
  for (const KeyFrameId id : a.map.keyframes().ids()) {
    EXPECT_EQ(a.map.keyframe(id).T_c_w.translation, b.map.keyframe(id).T_c_w.translation);
  }
  EXPECT_EQ(a.map.landmarks().ids(), b.map.landmarks().ids());
}

/// Sub-maps, each in a frame of its own, that meet at the place where the first one began: that of
/// keyframes 0 to 19, that of the end of the round, and one of the keyframes after these.
/// \param seed_of_others of the world of the second; 1: that of the first. Else there is no third
DriftedMap separate_submaps(int points, unsigned seed_of_others = 1) {
  constexpr int kEnds[] = {20, kLap + 6, kLap + 14};
  constexpr int kBegins[] = {0, kLap - 15, kLap + 6};
  FeatureWorld::Options options;
  options.points = points;
  options.pixel_noise = 0.3;
  options.flipped_bits = 10;
  const FeatureWorld first = testing::ring_world(options);
  options.seed = seed_of_others;
  const FeatureWorld others = testing::ring_world(options);
  const int parts = seed_of_others == 1 ? 3 : 2;
  options.max_distance = 30;
  DriftedMap made{Map(first.camera(), ScaleLevels(1.2, 8)), PlaceIndex(), {}};
  for (int k = 0; k < kEnds[2]; ++k) {
    made.truth.push_back(ring_pose(k * testing::ring_length() / kLap));
  }
  std::uint32_t next = 0;
  for (int part = 0; part < parts; ++part) {
    // The world of every part but the first is anywhere.
    const Rigid3 T_own_w =
        part == 0 ? Rigid3{}
                  : Rigid3(so3_exp({0.3 * part, -1.2, 0.5}), Eigen::Vector3d(100, -20 * part, 7));
    const std::vector<Rigid3> truth = made.truth;
    for (Rigid3& T : made.truth) T = T_own_w * T;
    std::vector<FeatureWorld::Point> moved = (part == 0 ? first : others).points();
    for (auto& p : moved) p.p_w = T_own_w * p.p_w;
    add_range(made, FeatureWorld(testing::kitti_camera(), options, moved), kBegins[part],
              kEnds[part], 0, next, false);
    made.truth = truth;
  }
  return made;
}

std::set<KeyFrameId> submaps_of(const Map& map) {
  std::set<KeyFrameId> submaps;
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) { submaps.insert(k.submap); });
  return submaps;
}

TEST_F(LoopCloserTest, MergesTwoSubmapsInTheFrameOfTheOlder) {
  DriftedMap made = separate_submaps(9000);
  ASSERT_EQ(made.map.submap(KeyFrameId{kLap}), KeyFrameId{kLap - 15});
  LoopCloser closer(LoopOptions{}, LocalBundleOptions{}, model_);
  const LoopReport report = closer.process(made.map, KeyFrameId{kLap + 5}, made.index);
  ASSERT_TRUE(report.closed);
  EXPECT_TRUE(report.merged);
  made.index.apply(made.map.take_changes());
  EXPECT_FALSE(made.map.keyframe(KeyFrameId{0}).parent.valid()) << "the older root stays";
  // The third is merged although this one has just been.
  const LoopReport next = closer.process(made.map, KeyFrameId{kLap + 12}, made.index);
  EXPECT_TRUE(next.merged);
  made.map.check_consistency();
  EXPECT_EQ(submaps_of(made.map), std::set<KeyFrameId>{KeyFrameId{0}});
  EXPECT_LT(worst(made), 0.15) << "all keyframes in one frame";
}

/// A bare scene: a keyframe sees 20 to 40 landmarks of the place, two thirds of what one alone
/// needs.
TEST_F(LoopCloserTest, SeveralKeyframesTogetherMergeSubmapsOfABareScene) {
  constexpr int kBare = 600;
  const auto merge = [&](int keyframe, bool together, DriftedMap& made) {
    made = separate_submaps(kBare);
    LoopOptions options;
    options.joint.enabled = together;
    return close(made, static_cast<std::uint32_t>(keyframe), options).merged;
  };
  DriftedMap made = separate_submaps(kBare);
  for (const int keyframe : {kLap, kLap + 3, kLap + 5}) {
    EXPECT_FALSE(merge(keyframe, false, made)) << keyframe << ": one keyframe sees too few";
    ASSERT_TRUE(merge(keyframe, true, made)) << keyframe;
    EXPECT_EQ(made.map.submap(KeyFrameId{kLap}), KeyFrameId{0});
    // The keyframes of both, in one frame.
    const Rigid3 T_0_w = made.map.keyframe(KeyFrameId{0}).T_c_w;
    const Rigid3 estimate = T_0_w * made.map.keyframe(KeyFrameId{kLap}).T_c_w.inverse();
    EXPECT_LT((estimate.t() - (made.truth[0].inverse() * made.truth[kLap]).t()).norm(), 0.15);
  }
}

/// The same path in another world, with landmarks that look otherwise.
TEST_F(LoopCloserTest, SubmapsOfTwoWorldsAreNotMerged) {
  int tried = 0;
  for (unsigned seed = 2; seed < 22; ++seed) {
    DriftedMap made = separate_submaps(seed % 2 == 0 ? 600 : 9000, seed);
    LoopCloser closer(LoopOptions{}, LocalBundleOptions{}, model_);
    for (const int keyframe : {kLap - 5, kLap, kLap + 5}) {
      const KeyFrameId id{static_cast<std::uint32_t>(keyframe)};
      EXPECT_FALSE(closer.join(made.map, id, made.index).merged) << seed << ", " << keyframe;
      ++tried;
    }
  }
  EXPECT_EQ(tried, 60);
}

}  // namespace
}  // namespace kys_slam
