// SPDX-License-Identifier: BSD-3-Clause
#include "retrieval/place_index.h"

#include <gtest/gtest.h>
#include <kys/prior.h>
#include <kys_slam/error.h>

#include <algorithm>

#include "place_fixtures.h"

namespace kys_slam {
namespace {

using testing::Answer;
using testing::ask;
using testing::features_of;
using testing::FeatureWorld;
using testing::IndexContent;
using testing::kitti_camera;
using testing::random_descriptor;
using testing::weaving_pose;
using testing::with_flips;
using testing::WorldMap;

std::vector<Rigid3> drive(int keyframes, double step) {
  std::vector<Rigid3> poses;
  for (int k = 0; k < keyframes; ++k) poses.push_back(weaving_pose(step * k));
  return poses;
}

FeatureWorld long_world(int flipped_bits = 0) {
  FeatureWorld::Options options;
  options.points = 8000;
  options.length = 120;
  options.max_distance = 25;
  options.flipped_bits = flipped_bits;
  return {kitti_camera(), options};
}

std::vector<KeyFrameId> keyframes_of(const Answer& answer) {
  std::vector<KeyFrameId> ids;
  for (const PlaceCandidate& c : answer.candidates) ids.push_back(c.keyframe);
  return ids;
}

TEST(PlaceIndex, EveryKeyframeOfADriveFindsItself) {
  const FeatureWorld world = long_world();
  WorldMap built = map_of_world(world, drive(20, 4));
  PlaceIndex index;
  index.apply(built.map.take_changes());
  EXPECT_EQ(index.landmarks(), built.map.landmarks().size());
  EXPECT_EQ(index.keyframes(), 20u);
  for (std::uint32_t k = 0; k < 20; ++k) {
    const Answer answer = ask(index, *built.seen[k].features);
    ASSERT_FALSE(answer.candidates.empty());
    EXPECT_EQ(answer.candidates.front().keyframe, KeyFrameId{k});
    EXPECT_GT(answer.candidates.front().votes, 100);
    EXPECT_GT(answer.statistics.total(), 0u);
  }
}

TEST(PlaceIndex, ARevisitOfNoisyDescriptorsFindsThePlace) {
  const FeatureWorld world = long_world(30);  // of 256 bits, in the map and in the query
  WorldMap built = map_of_world(world, drive(20, 4));
  PlaceIndex index;
  index.apply(built.map.take_changes());
  for (int k = 1; k < 19; ++k) {
    const auto seen = see(world, 1000 + k, weaving_pose(4 * k + 0.8));
    const Answer answer = ask(index, *seen.features);
    ASSERT_FALSE(answer.candidates.empty());
    const auto found = static_cast<int>(answer.candidates.front().keyframe.value);
    EXPECT_LE(std::abs(found - k), 1) << k;
  }
}

TEST(PlaceIndex, CandidatesComeBestFirstAndNoMoreThanAskedFor) {
  const FeatureWorld world = long_world(10);
  WorldMap built = map_of_world(world, drive(20, 4));
  PlaceIndex index;
  index.apply(built.map.take_changes());
  const FrameFeatures& features = *built.seen[10].features;
  const Answer all = ask(index, features);
  ASSERT_GE(all.candidates.size(), 2u);
  for (std::size_t i = 1; i < all.candidates.size(); ++i) {
    const PlaceCandidate& a = all.candidates[i - 1];
    const PlaceCandidate& b = all.candidates[i];
    EXPECT_TRUE(a.score > b.score || (a.score == b.score && a.keyframe < b.keyframe));
  }
  const Answer one = ask(index, features, {}, 1);
  ASSERT_EQ(one.candidates.size(), 1u);
  EXPECT_EQ(one.candidates.front(), all.candidates.front());
  EXPECT_TRUE(ask(index, features, {}, 0).candidates.empty());
}

TEST(PlaceIndex, ExcludedAndCulledKeyframesAreNeverReturned) {
  const FeatureWorld world = long_world();
  WorldMap built = map_of_world(world, drive(12, 3));
  PlaceIndex index;
  index.apply(built.map.take_changes());
  const FrameFeatures& features = *built.seen[6].features;
  const std::vector<KeyFrameId> excluded{{5}, {6}, {9999}};  // one of them unknown
  const std::vector<KeyFrameId> left = keyframes_of(ask(index, features, excluded));
  ASSERT_FALSE(left.empty());
  for (const KeyFrameId id : left) {
    EXPECT_NE(id, KeyFrameId{5});
    EXPECT_NE(id, KeyFrameId{6});
  }
  ASSERT_TRUE(built.map.cull_keyframe(KeyFrameId{6}));
  index.apply(built.map.take_changes());
  EXPECT_EQ(index.keyframes(), 11u);
  EXPECT_EQ(index.landmarks(), built.map.landmarks().size());
  for (const KeyFrameId id : keyframes_of(ask(index, features))) EXPECT_NE(id, KeyFrameId{6});
}

TEST(PlaceIndex, ALandmarkOfExcludedKeyframesHidesNoOtherOne) {
  // The recent duplicate of a landmark is nearer than the old one; only the old one may vote.
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  content.add_keyframe(1);
  std::vector<kys::Descriptor> query;
  for (std::uint32_t i = 0; i < 200; ++i) {
    query.push_back(random_descriptor(random));
    content.see(2 * i, with_flips(query.back(), 20, random), {KeyFrameId{0}});
    content.see(2 * i + 1, query.back(), {KeyFrameId{1}});
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  const FrameFeatures features = features_of(query);
  EXPECT_EQ(keyframes_of(ask(index, features)), std::vector<KeyFrameId>{{1}});
  const Answer old = ask(index, features, {{1}});
  EXPECT_EQ(keyframes_of(old), std::vector<KeyFrameId>{{0}});
  EXPECT_GT(old.candidates.front().votes, 150);
}

TEST(PlaceIndex, NothingInNothingOut) {
  PlaceIndex index;
  std::mt19937_64 random(1);
  const FrameFeatures features = features_of({random_descriptor(random)});
  EXPECT_TRUE(ask(index, features).candidates.empty());
  EXPECT_TRUE(ask(index, FrameFeatures{}).candidates.empty());
  index.apply(ChangeSet{});
  EXPECT_EQ(index.landmarks(), 0u);

  IndexContent content;
  content.add_keyframe(3);  // sees nothing
  index.apply(content.as_changes());
  EXPECT_TRUE(ask(index, features).candidates.empty());
  content.see(0, features.descriptor(0), {});                // seen by nobody
  content.see(1, features.descriptor(0), {KeyFrameId{77}});  // by a keyframe that is not there
  index.apply(content.as_changes());
  EXPECT_EQ(index.landmarks(), 2u);
  EXPECT_TRUE(ask(index, features).candidates.empty());
  content.see(2, features.descriptor(0), {KeyFrameId{3}});
  index.apply(content.as_changes());
  EXPECT_EQ(keyframes_of(ask(index, features)), std::vector<KeyFrameId>{{3}});
  EXPECT_TRUE(ask(index, FrameFeatures{}).candidates.empty());
}

/// Random landmarks of `keyframes` keyframes that see a few of them each.
IndexContent random_content(std::uint32_t keyframes, std::uint32_t landmarks, unsigned seed) {
  std::mt19937_64 random(seed);
  IndexContent content;
  for (std::uint32_t k = 0; k < keyframes; ++k) {
    content.add_keyframe(k, {KeyFrameId{(k + 1) % keyframes}});
  }
  for (std::uint32_t i = 0; i < landmarks; ++i) {
    std::vector<KeyFrameId> observers;
    const std::uint64_t first = random() % keyframes;
    for (std::uint64_t k = first; k < std::min<std::uint64_t>(first + 3, keyframes); ++k) {
      observers.push_back(KeyFrameId{static_cast<std::uint32_t>(k)});
    }
    content.see(i, random_descriptor(random), observers);
  }
  return content;
}

/// Noisy looks at the landmarks of one keyframe each.
std::vector<FrameFeatures> random_queries(const IndexContent& content, unsigned seed) {
  std::mt19937_64 random(seed);
  std::vector<FrameFeatures> queries;
  for (const auto& [id, keyframe] : content.keyframes) {
    std::vector<kys::Descriptor> descriptors;
    for (const auto& [landmark, view] : content.landmarks) {
      if (std::find(view.observers.begin(), view.observers.end(), id) == view.observers.end()) {
        continue;
      }
      descriptors.push_back(with_flips(view.descriptor, 25, random));
    }
    queries.push_back(features_of(descriptors));
  }
  return queries;
}

TEST(PlaceIndex, TheOrderInWhichLandmarksCameDoesNotMatter) {
  const IndexContent content = random_content(20, 4000, 1);
  const std::vector<FrameFeatures> queries = random_queries(content, 2);
  PlaceIndex reference;
  reference.apply(content.as_changes());
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 3; ++trial) {
    const ChangeSet all = content.as_changes();
    auto landmarks = all.landmarks;
    std::shuffle(landmarks.begin(), landmarks.end(), random);
    PlaceIndex index;
    for (std::size_t i = 0; i < landmarks.size(); i += 500) {
      ChangeSet part;
      part.landmarks.assign(landmarks.begin() + static_cast<std::ptrdiff_t>(i),
                            landmarks.begin() + static_cast<std::ptrdiff_t>(i + 500));
      index.apply(part);
    }
    ChangeSet keyframes;
    keyframes.keyframes = all.keyframes;
    index.apply(keyframes);
    for (const FrameFeatures& query : queries) {
      const Answer expected = ask(reference, query);
      EXPECT_FALSE(expected.candidates.empty());
      EXPECT_EQ(ask(index, query), expected);
    }
  }
}

TEST(PlaceIndex, AfterAnyChangesItIsAsIfBuiltFromScratch) {
  IndexContent content = random_content(20, 3000, 1);
  const std::vector<FrameFeatures> queries = random_queries(content, 2);
  PlaceIndex index;
  index.apply(content.as_changes());
  std::mt19937_64 random(4);
  std::uint32_t next = 3000;
  for (int step = 0; step < 30; ++step) {
    ChangeSet changes;
    std::set<LandmarkId> touched;
    for (int n = 0; n < 200; ++n) {
      const LandmarkId id{static_cast<std::uint32_t>(random() % next)};
      if (!content.landmarks.contains(id) || !touched.insert(id).second) continue;
      LandmarkView& view = content.landmarks[id];
      switch (random() % 5) {
        case 0:
          content.landmarks.erase(id);
          changes.erased_landmarks.push_back(id);
          continue;
        case 1:
          view.descriptor = random_descriptor(random);
          break;
        case 2:
          view.observers = {KeyFrameId{static_cast<std::uint32_t>(random() % 20)}};
          break;
        case 3:
          view.observers.clear();
          break;
        default:
          view.prior.instance = n;
      }
      changes.landmarks.emplace_back(id, view);
    }
    std::sort(changes.erased_landmarks.begin(), changes.erased_landmarks.end());
    for (int n = 0; n < 40; ++n) {
      content.see(next, random_descriptor(random),
                  {KeyFrameId{static_cast<std::uint32_t>(random() % 20)}});
      changes.landmarks.emplace_back(LandmarkId{next}, content.landmarks[LandmarkId{next}]);
      ++next;
    }
    if (step == 15) {
      content.keyframes.erase(KeyFrameId{7});
      changes.culled_keyframes.push_back({KeyFrameId{7}, KeyFrameId{6}, {}});
    }
    index.apply(changes);
  }
  PlaceIndex rebuilt;
  rebuilt.apply(content.as_changes());
  EXPECT_EQ(index.landmarks(), rebuilt.landmarks());
  EXPECT_EQ(index.keyframes(), rebuilt.keyframes());
  for (const FrameFeatures& query : queries) EXPECT_EQ(ask(index, query), ask(rebuilt, query));
}

TEST(PlaceIndex, ReplacedLandmarksVoteForTheKeyframesOfBoth) {
  const FeatureWorld world = long_world();
  WorldMap built = map_of_world(world, drive(10, 3));
  PlaceIndex index;
  index.apply(built.map.take_changes());
  const std::vector<LandmarkId> ids = built.map.landmarks().ids();
  for (std::size_t i = 0; i + 1 < ids.size(); i += 50) {
    built.map.replace_landmark(ids[i], ids[i + 1]);
  }
  index.apply(built.map.take_changes());
  EXPECT_EQ(index.landmarks(), built.map.landmarks().size());
  PlaceIndex rebuilt;
  ChangeSet all;
  built.map.landmarks().for_each(
      [&](LandmarkId id, const Landmark&) { all.landmarks.emplace_back(id, built.map.view(id)); });
  built.map.keyframes().for_each(
      [&](KeyFrameId id, const KeyFrame&) { all.keyframes.emplace_back(id, built.map.view(id)); });
  rebuilt.apply(all);
  for (const auto& seen : built.seen) {
    EXPECT_EQ(ask(index, *seen.features), ask(rebuilt, *seen.features));
  }
}

TEST(PlaceIndex, LookAlikesAreBothReturnedLowerIdFirst) {
  std::mt19937_64 random(1);
  IndexContent content;
  std::vector<kys::Descriptor> facade;
  for (std::uint32_t k : {4u, 2u, 9u}) content.add_keyframe(k);
  for (std::uint32_t i = 0; i < 300; ++i) {
    facade.push_back(random_descriptor(random));
    content.see(3 * i, facade.back(), {KeyFrameId{4}});
    content.see(3 * i + 1, facade.back(), {KeyFrameId{2}});
    content.see(3 * i + 2, random_descriptor(random), {KeyFrameId{9}});
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  const Answer answer = ask(index, features_of(facade));
  ASSERT_EQ(keyframes_of(answer), (std::vector<KeyFrameId>{{2}, {4}}));
  EXPECT_EQ(answer.candidates[0].score, answer.candidates[1].score);
  EXPECT_EQ(answer.candidates[0].votes, 300);
}

TEST(PlaceIndex, ARepeatedPatternGetsOneVoteForEachLandmark) {
  // Keyframe 0 shows one window, keyframe 1 twenty different things; the query shows the window a
  // hundred times and the twenty things.
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  content.add_keyframe(1);
  const kys::Descriptor window = random_descriptor(random);
  std::vector<kys::Descriptor> query(100, window);
  for (std::uint32_t i = 0; i < 20; ++i) {
    content.see(2 * i, i == 0 ? window : random_descriptor(random), {KeyFrameId{0}});
    query.push_back(random_descriptor(random));
    content.see(2 * i + 1, query.back(), {KeyFrameId{1}});
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  const Answer answer = ask(index, features_of(query));
  ASSERT_EQ(keyframes_of(answer), (std::vector<KeyFrameId>{{1}, {0}}));
  EXPECT_EQ(answer.candidates[0].votes, 20);
  EXPECT_EQ(answer.candidates[1].votes, 1);
}

TEST(PlaceIndex, WhatIsEverywhereIsPassedOver) {
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  const kys::Descriptor brick = random_descriptor(random);
  for (std::uint32_t i = 0; i < 5000; ++i) content.see(i, brick, {KeyFrameId{0}});
  PlaceIndex index;
  index.apply(content.as_changes());
  const Answer answer = ask(index, features_of(std::vector<kys::Descriptor>(1000, brick)));
  EXPECT_TRUE(answer.candidates.empty());
  EXPECT_EQ(answer.statistics.total(), 0u);
}

TEST(PlaceIndex, ManyLandmarksAreNoAdvantage) {
  // Both keyframes have a hundred landmarks of the query; one has 200 in all, the other one 2000.
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  content.add_keyframe(1);
  std::vector<kys::Descriptor> query;
  for (std::uint32_t i = 0; i < 2200; ++i) {
    const kys::Descriptor d = random_descriptor(random);
    const std::uint32_t k = i < 2000 ? 0 : 1;
    content.see(i, d, {KeyFrameId{k}});
    if (i < 100 || i >= 2100) query.push_back(d);
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  const Answer answer = ask(index, features_of(query));
  ASSERT_EQ(keyframes_of(answer), (std::vector<KeyFrameId>{{1}, {0}}));
  EXPECT_EQ(answer.candidates[0].votes, answer.candidates[1].votes);
  EXPECT_GT(answer.candidates[0].score, 1.5 * answer.candidates[1].score);
}

TEST(PlaceIndex, FewVotesForATinyKeyframeAreNoMatch) {
  // Keyframe 0 has four landmarks and gets a vote for each; keyframe 1 gets 200 of 500.
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  content.add_keyframe(1);
  std::vector<kys::Descriptor> query;
  for (std::uint32_t i = 0; i < 504; ++i) {
    const kys::Descriptor d = random_descriptor(random);
    content.see(i, d, {KeyFrameId{i < 4 ? 0u : 1u}});
    if (i < 204) query.push_back(d);
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  EXPECT_EQ(ask(index, features_of(query)).candidates.front().keyframe, KeyFrameId{1});
}

TEST(PlaceIndex, CovisibleKeyframesSupportEachOther) {
  // Keyframes 1 to 5 see neighbouring parts of a place; keyframe 9, alone, gets a few votes more
  // than any of them.
  std::mt19937_64 random(1);
  IndexContent content;
  for (std::uint32_t k = 1; k <= 5; ++k) {
    std::vector<KeyFrameId> others;
    for (std::uint32_t o = 1; o <= 5; ++o) {
      if (o != k) others.push_back(KeyFrameId{o});
    }
    content.add_keyframe(k, others);
  }
  content.add_keyframe(9);
  std::vector<kys::Descriptor> query;
  std::uint32_t next = 0;
  const auto add = [&](std::uint32_t keyframe, int landmarks, int in_query) {
    for (int i = 0; i < landmarks; ++i) {
      const kys::Descriptor d = random_descriptor(random);
      content.see(next++, d, {KeyFrameId{keyframe}});
      if (i < in_query) query.push_back(d);
    }
  };
  for (std::uint32_t k = 1; k <= 5; ++k) add(k, 300, k == 3 ? 54 : 50);
  add(9, 300, 56);
  PlaceIndex index;
  index.apply(content.as_changes());
  const Answer answer = ask(index, features_of(query));
  // One candidate stands for the group: its best member.
  ASSERT_EQ(keyframes_of(answer), (std::vector<KeyFrameId>{{3}, {9}}));
  EXPECT_EQ(answer.candidates[0].votes, 54);
}

TEST(PlaceIndex, DistancesAreThoseOfTheMode) {
  // Landmarks of a moving segment: the gate of mode kys keeps them from voting.
  kys::ModeOptions options;
  options.mode = kys::Mode::kKys;
  const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  const kys::DistanceModel gating(options, space);
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  const kys::Prior still = kys::make_prior(1, 5, 100.0f, 0.0f, false);
  const kys::Prior moving = kys::make_prior(1, 5, 100.0f, 60.0f, true);
  std::vector<kys::Descriptor> query;
  for (std::uint32_t i = 0; i < 100; ++i) {
    query.push_back(random_descriptor(random));
    content.see(i, query.back(), {KeyFrameId{0}});
    content.landmarks[LandmarkId{i}].prior = i < 40 ? moving : still;
  }
  PlaceIndex index;
  index.apply(content.as_changes());
  const FrameFeatures features = features_of(query, std::vector<kys::Prior>(100, still));
  const Answer stock = ask(index, features);
  ASSERT_EQ(stock.candidates.size(), 1u);
  EXPECT_EQ(stock.candidates.front().votes, 100);
  const Answer gated = ask(index, features, {}, 10, gating);
  ASSERT_EQ(gated.candidates.size(), 1u);
  EXPECT_EQ(gated.candidates.front().votes, 60);
  EXPECT_EQ(gated.statistics.gated(), 40u);
  EXPECT_EQ(gated.statistics.accepted_of(kys::Tier::kSameInstance), 60u);
}

TEST(PlaceIndex, OnlyTheStrongestFeaturesAsk) {
  PlaceOptions options;
  options.max_features = 50;
  std::mt19937_64 random(1);
  IndexContent content;
  content.add_keyframe(0);
  content.add_keyframe(1);
  FeatureSet set;
  for (std::uint32_t i = 0; i < 100; ++i) {
    Keypoint keypoint;
    keypoint.response = i % 2 == 0 ? 20 : 40;
    set.keypoints.push_back(keypoint);
    set.descriptors.push_back(random_descriptor(random));
    content.see(i, set.descriptors.back(), {KeyFrameId{i % 2}});
  }
  PlaceIndex index(options);
  index.apply(content.as_changes());
  const FrameFeatures features(kitti_camera(), set, std::vector<float>(100, 0), {});
  const Answer answer = ask(index, features);
  ASSERT_EQ(keyframes_of(answer), std::vector<KeyFrameId>{{1}});
  EXPECT_EQ(answer.candidates.front().votes, 50);
}

TEST(PlaceIndex, TwoHundredThousandLandmarks) {
  constexpr std::uint32_t kKeyframes = 1000;
  constexpr std::uint32_t kLandmarks = 200000;
  std::mt19937_64 random(1);
  PlaceIndex index;
  std::vector<kys::Descriptor> descriptors;
  for (std::uint32_t k = 0; k < kKeyframes; ++k) {
    ChangeSet changes;
    for (std::uint32_t i = 0; i < kLandmarks / kKeyframes; ++i) {
      LandmarkView view;
      view.descriptor = random_descriptor(random);
      for (std::uint32_t o = 0; o < 5; ++o) view.observers.push_back(KeyFrameId{k + o});
      changes.landmarks.emplace_back(LandmarkId{static_cast<std::uint32_t>(descriptors.size())},
                                     view);
      descriptors.push_back(view.descriptor);
    }
    changes.keyframes.emplace_back(KeyFrameId{k}, KeyFrameView{});
    index.apply(changes);
  }
  EXPECT_EQ(index.landmarks(), kLandmarks);
  const double bytes = static_cast<double>(index.bytes()) / kLandmarks;
  RecordProperty("bytes_per_landmark", std::to_string(bytes));
  EXPECT_LT(bytes, 32 + 115);
  for (const std::uint32_t k : {100u, 500u, 900u}) {
    // Keyframe k observes the landmarks of five steps; a fifth of them is seen again, with noise.
    std::vector<kys::Descriptor> query;
    for (std::uint32_t i = (k - 4) * 200; i < (k + 1) * 200; i += 2) {
      query.push_back(i % 5 < 2 ? with_flips(descriptors[i], 35, random)
                                : random_descriptor(random));
    }
    const Answer answer = ask(index, features_of(query));
    ASSERT_FALSE(answer.candidates.empty());
    EXPECT_EQ(answer.candidates.front().keyframe, KeyFrameId{k});
    // 35 bits of noise: a table finds a landmark with probability 0.085, one of eight with 0.51.
    EXPECT_GT(answer.candidates.front().votes, 70);
    // Few are compared: about three landmarks in each of eight buckets.
    EXPECT_LT(answer.statistics.total(), 40u * query.size());
  }
}

TEST(PlaceOptions, WhatMakesNoSenseIsRefused) {
  const auto refused = [](auto change) {
    PlaceOptions options;
    change(options);
    EXPECT_THROW(PlaceIndex{options}, InputError);
  };
  refused([](PlaceOptions& o) { o.tables = 0; });
  refused([](PlaceOptions& o) { o.tables = 17; });
  refused([](PlaceOptions& o) { o.max_bucket = 0; });
  refused([](PlaceOptions& o) { o.max_features = 0; });
  refused([](PlaceOptions& o) { o.max_distance = 0; });
  refused([](PlaceOptions& o) { o.max_distance = kys::kRejected; });
  refused([](PlaceOptions& o) { o.margin = -1; });
}

}  // namespace
}  // namespace kys_slam
