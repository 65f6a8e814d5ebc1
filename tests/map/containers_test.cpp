// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <map>
#include <new>
#include <random>
#include <set>
#include <string>

#include "map/id_table.h"
#include "map/ids.h"
#include "map/sort_ids.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

using Table = IdTable<LandmarkId, std::string>;

TEST(IdTable, FindsWhatWasPutAndNothingElse) {
  Table table;
  EXPECT_TRUE(table.empty());
  EXPECT_FALSE(table.contains({0}));
  EXPECT_FALSE(table.contains(LandmarkId{}));
  table.put({7}, "seven");
  table.put({2}, "two");
  EXPECT_EQ(table.size(), 2u);
  EXPECT_EQ(table.id_end(), 8u);
  EXPECT_EQ(table.at({7}), "seven");
  EXPECT_EQ(*table.find({2}), "two");
  EXPECT_EQ(table.find({3}), nullptr);
  EXPECT_THROW((void)table.at({3}), std::out_of_range);
  EXPECT_THROW((void)table.at(LandmarkId{}), std::out_of_range);
  table.put({7}, "another");
  EXPECT_EQ(table.size(), 2u);
  EXPECT_EQ(table.at({7}), "another");
}

TEST(IdTable, UsesSlotsOfErasedObjectsAgainAndKeepsReferencesOfOthers) {
  Table table;
  for (std::uint32_t i = 0; i < 100; ++i) table.put({i}, std::to_string(i));
  const std::string* kept = table.find({50});
  EXPECT_TRUE(table.erase({10}));
  EXPECT_FALSE(table.erase({10}));
  EXPECT_FALSE(table.erase({1000}));
  for (std::uint32_t i = 100; i < 2000; ++i) {
    table.put({i}, std::to_string(i));
    EXPECT_TRUE(table.erase({i}));
  }
  EXPECT_EQ(kept, table.find({50}));
  EXPECT_EQ(*kept, "50");
  EXPECT_EQ(table.size(), 99u);
  EXPECT_EQ(table.id_end(), 2000u);
}

TEST(IdTable, ACopyIsItsOwn) {
  Table table;
  for (std::uint32_t i = 0; i < 150; ++i) table.put({i}, std::to_string(i));
  table.erase({70});
  Table copy = table;
  copy.at({3}) = "changed";
  copy.put({150}, "new");
  EXPECT_EQ(table.at({3}), "3");
  EXPECT_FALSE(table.contains({150}));
  EXPECT_EQ(copy.size(), 150u);
  EXPECT_EQ(copy.at({149}), "149");
  Table moved = std::move(copy);
  EXPECT_EQ(moved.at({3}), "changed");
  table = moved;
  EXPECT_EQ(table.at({150}), "new");
}

/// An object that needs memory, of which there is enough for `left` more.
struct Costly {
  static int left;
  Costly() {
    if (left-- <= 0) throw std::bad_alloc();
  }
  explicit Costly(int n) : number(n) {}
  int number = 0;
};
int Costly::left = 0;

TEST(IdTable, AnObjectForWhichThereIsNoMemoryIsNotInTheTable) {
  IdTable<LandmarkId, Costly> table;
  Costly::left = 70;  // more than one block, less than two
  std::uint32_t put = 0;
  EXPECT_THROW(
      {
        for (; put < 1000; ++put) table.put({put}, Costly(static_cast<int>(put)));
      },
      std::bad_alloc);
  ASSERT_GT(put, 0u);
  ASSERT_LT(put, 1000u);
  EXPECT_EQ(table.size(), put);
  EXPECT_FALSE(table.contains({put}));
  EXPECT_EQ(table.find({put}), nullptr);
  EXPECT_EQ(table.ids().size(), put);

  Costly::left = 1000;
  table.put({put}, Costly(7));
  EXPECT_EQ(table.size(), put + 1);
  EXPECT_EQ(table.at({put}).number, 7);
  EXPECT_EQ(table.at({put - 1}).number, static_cast<int>(put) - 1);
}

TEST(IdTable, VisitsThePresentOnesOfAListInItsOrder) {
  Table table;
  std::vector<LandmarkId> wanted;
  std::vector<std::string> expected;
  for (std::uint32_t i = 0; i < 200; ++i) {
    const LandmarkId id{i * 7 % 200};
    wanted.push_back(id);
    if (id.value % 3 == 0) continue;
    table.put(id, std::to_string(id.value));
    expected.push_back(std::to_string(id.value));
  }
  wanted.push_back(LandmarkId{});
  wanted.push_back({100000});
  wanted.push_back({1});
  expected.push_back("1");
  std::vector<std::string> seen;
  table.visit(wanted, [&](LandmarkId id, const std::string& object) {
    EXPECT_EQ(object, std::to_string(id.value));
    seen.push_back(object);
  });
  EXPECT_EQ(seen, expected);
}

TEST(IdTable, BehavesLikeAnOrderedMap) {
  std::mt19937 random(5);
  Table table;
  std::map<LandmarkId, std::string> reference;
  for (int step = 0; step < 20000; ++step) {
    const LandmarkId id{static_cast<std::uint32_t>(random() % 300)};
    if (random() % 2 == 0) {
      const std::string text = std::to_string(step);
      table.put(id, text);
      reference[id] = text;
    } else {
      EXPECT_EQ(table.erase(id), reference.erase(id) == 1);
    }
    ASSERT_EQ(table.size(), reference.size());
  }
  auto expected = reference.begin();
  table.for_each([&](LandmarkId id, const std::string& text) {
    ASSERT_NE(expected, reference.end());
    EXPECT_EQ(id, expected->first);
    EXPECT_EQ(text, expected->second);
    ++expected;
  });
  EXPECT_EQ(expected, reference.end());
  table.clear();
  EXPECT_TRUE(table.empty());
  EXPECT_TRUE(table.ids().empty());
}

TEST(IdTable, KnowsWhatReplacedAnObject) {
  Table table;
  for (std::uint32_t i = 0; i < 6; ++i) table.put({i}, std::to_string(i));
  table.replace({1}, {2});
  table.replace({2}, {5});  // a chain
  table.erase({3});
  table.replace({9}, {4});  // was never in the table
  EXPECT_EQ(table.size(), 3u);
  EXPECT_FALSE(table.contains({1}));
  EXPECT_EQ(table.resolve({0}), LandmarkId{0});
  EXPECT_EQ(table.resolve({1}), LandmarkId{5});
  EXPECT_EQ(table.resolve({3}), LandmarkId{});
  EXPECT_EQ(table.resolve({9}), LandmarkId{4});
  EXPECT_EQ(table.resolve({100}), LandmarkId{});
  EXPECT_EQ(table.resolve({}), LandmarkId{});
  EXPECT_EQ(table.ids(), (std::vector<LandmarkId>{{0}, {4}, {5}}));
  table.erase({5});
  EXPECT_EQ(table.resolve({1}), LandmarkId{});  // its last successor is gone
  EXPECT_THROW(table.replace({0}, {0x80000000u}), std::length_error);
}

TEST(ScaleLevels, ScalesGrowByTheFactorAndOctavesArePredictedByDistance) {
  const ScaleLevels scales(1.2, 8);
  ASSERT_EQ(scales.levels(), 8);
  EXPECT_FLOAT_EQ(scales.scale[0], 1);
  EXPECT_NEAR(scales.scale[3], 1.728, 1e-6);
  EXPECT_NEAR(scales.inv_sigma(1), 1 / (1.2 * kPixelSigma), 1e-6);
  // Seen from its largest distance a landmark is on octave 0; 1.2 times nearer, on octave 1.
  EXPECT_EQ(scales.predict_octave(10, 10), 0);
  EXPECT_EQ(scales.predict_octave(10, 12), 0);
  EXPECT_EQ(scales.predict_octave(10, 10 / 1.19f), 1);
  EXPECT_EQ(scales.predict_octave(10, 10 / 1.43f), 2);
  EXPECT_EQ(scales.predict_octave(10, 0.01f), 7);
}

TEST(FrameFeatures, FindsNeighboursAsBruteForceDoes) {
  const StereoCamera camera = testing::kitti_camera();
  const auto features = testing::random_features(camera, 1500, 3);
  std::mt19937 random(8);
  std::uniform_real_distribution<float> unit(-0.2f, 1.2f);
  for (int query = 0; query < 400; ++query) {
    const float u = unit(random) * static_cast<float>(camera.width);
    const float v = unit(random) * static_cast<float>(camera.height);
    const float radius = 200 * (unit(random) + 0.2f);
    const int low = static_cast<int>(random() % 9) - 1;
    const int high = low + static_cast<int>(random() % 4);
    std::set<std::size_t> expected;
    for (std::size_t i = 0; i < features->size(); ++i) {
      const Keypoint& k = features->keypoint(i);
      if (k.octave >= low && k.octave <= high && std::abs(k.x - u) <= radius &&
          std::abs(k.y - v) <= radius) {
        expected.insert(i);
      }
    }
    std::set<std::size_t> found;
    features->for_each_near(u, v, radius, low, high, [&](std::size_t i) {
      EXPECT_TRUE(found.insert(i).second) << "feature " << i << " was visited twice";
    });
    ASSERT_EQ(found, expected) << "around " << u << ", " << v << " radius " << radius;
  }
}

TEST(FrameFeatures, ASubsetIsVisitedInTheOrderOfTheWhole) {
  const StereoCamera camera = testing::kitti_camera();
  const auto features = testing::random_features(camera, 1500, 4);
  std::vector<std::uint8_t> keep(features->size());
  std::vector<std::size_t> whole_index;  // by index in the subset
  for (std::size_t i = 0; i < keep.size(); ++i) {
    keep[i] = i % 3 == 0 ? 1 : 0;
    if (keep[i] != 0) whole_index.push_back(i);
  }
  const FrameFeatures subset = features->subset(keep);
  std::mt19937 random(9);
  std::uniform_real_distribution<float> unit(-0.2f, 1.2f);
  std::size_t visits = 0;
  for (int query = 0; query < 400; ++query) {
    const float u = unit(random) * static_cast<float>(camera.width);
    const float v = unit(random) * static_cast<float>(camera.height);
    const float radius = 100 * (unit(random) + 0.2f);
    std::vector<std::size_t> expected, found;
    features->for_each_near(u, v, radius, 0, 7, [&](std::size_t i) {
      if (keep[i] != 0) expected.push_back(i);
    });
    subset.for_each_near(u, v, radius, 0, 7,
                         [&](std::size_t i) { found.push_back(whole_index[i]); });
    ASSERT_EQ(found, expected) << "around " << u << ", " << v << " radius " << radius;
    visits += found.size();
  }
  EXPECT_GT(visits, 1000u);
}

TEST(FrameFeatures, SearchFarOutsideTheImageFindsNothing) {
  const auto features = testing::random_features(testing::kitti_camera(), 200, 3);
  for (const float far : {-1e30f, 1e30f, -5000.0f, 1e9f}) {
    features->for_each_near(far, far, 50, 0, 7, [](std::size_t) { ADD_FAILURE(); });
  }
  FrameFeatures().for_each_near(0, 0, 1e9f, 0, 7, [](std::size_t) { ADD_FAILURE(); });
}

TEST(FrameFeatures, DepthFollowsDisparityAndItsOffset) {
  const StereoCamera camera = testing::kitti_camera();
  FeatureSet set;
  set.keypoints = {{100, 50, 0, 1, 0}, {300, 50, 0, 1, 0}, {500, 80, 0, 1, 2}};
  set.descriptors.resize(3);
  const FrameFeatures plain(camera, set, RightPositions({90, testing::kNoStereo, 500.5f}), {});
  EXPECT_FLOAT_EQ(plain.depth(0), static_cast<float>(camera.bf() / 10));
  EXPECT_FALSE(plain.has_stereo(1));
  EXPECT_FALSE(plain.has_stereo(2)) << "a negative disparity has no depth";

  const auto offset = [&](double px) { return RigCorrection::of_offset(camera, px); };
  const FrameFeatures shifted = plain.with_rig(offset(0.75));
  EXPECT_EQ(shifted.rig(), offset(0.75));
  EXPECT_FLOAT_EQ(shifted.u_right(0), 89.25f);
  EXPECT_FLOAT_EQ(shifted.depth(0), static_cast<float>(camera.bf() / 10.75));
  EXPECT_TRUE(std::isnan(shifted.u_right(1)));
  EXPECT_FALSE(shifted.has_stereo(1));
  EXPECT_TRUE(shifted.has_stereo(2)) << "the offset makes the disparity positive";
  EXPECT_EQ(shifted.keypoints().size(), 3u);

  // An offset given at once, and one replaced by another, are the same.
  const FrameFeatures direct(camera, set, RightPositions({90, testing::kNoStereo, 500.5f}), {},
                             offset(0.75));
  const FrameFeatures again = plain.with_rig(offset(0.25)).with_rig(offset(0.75));
  for (std::size_t i : {0u, 2u}) {
    EXPECT_FLOAT_EQ(direct.u_right(i), shifted.u_right(i));
    EXPECT_FLOAT_EQ(again.u_right(i), shifted.u_right(i));
    EXPECT_FLOAT_EQ(again.depth(i), shifted.depth(i));
  }
  const FrameFeatures back = again.with_rig({});
  EXPECT_EQ(back.u_right(0), 90);
}

TEST(FrameFeatures, AnAlignedKeypointTakesItsDisparityAlong) {
  const StereoCamera camera = testing::kitti_camera();
  const ScaleLevels scales(1.2, 8);
  FeatureSet set;
  set.keypoints = {{100, 50, 0, 1, 0}, {300, 50, 0, 1, 2}};
  set.descriptors.resize(2);
  const FrameFeatures found(camera, set, RightPositions({90, testing::kNoStereo}), {});
  const std::vector<FrameFeatures::Aligned> places{{0, 160.25f, 49.5f}};
  const FrameFeatures aligned = found.with_aligned(places);
  EXPECT_FALSE(found.is_aligned(0));
  EXPECT_TRUE(aligned.is_aligned(0));
  EXPECT_FALSE(aligned.is_aligned(1));
  EXPECT_FLOAT_EQ(aligned.keypoint(0).x, 160.25f);
  EXPECT_FLOAT_EQ(aligned.keypoint(0).y, 49.5f);
  EXPECT_FLOAT_EQ(aligned.depth(0), found.depth(0));
  EXPECT_FLOAT_EQ(aligned.stereo_pixel(0, scales).inv_sigma, 1 / kAlignedSigma);
  EXPECT_FLOAT_EQ(aligned.stereo_pixel(1, scales).inv_sigma, 1 / (kPixelSigma * 1.44f));
  // Only images have the noise of images: simulated features have the same in u, v and disparity.
  EXPECT_EQ(found.stereo_pixel(0, scales).ratio.v, 1);
  EXPECT_EQ(found.stereo_pixel(0, scales).ratio.disparity, 1);
  const std::vector<std::uint8_t> second{0, 1};
  const FrameFeatures restored =
      FrameFeatures::restore(camera, set, RightPositions({90, 250}), {}, {1, 0}, {});
  for (const FrameFeatures& f : {found.with_image_noise(), aligned, aligned.subset(second),
                                 aligned.with_priors({}), restored}) {
    EXPECT_EQ(f.stereo_pixel(0, scales).ratio.v, kImageInformation.v);
    EXPECT_EQ(f.stereo_pixel(0, scales).ratio.disparity, kImageInformation.disparity);
  }
  int here = 0, there = 0;
  aligned.for_each_near(160.25f, 49.5f, 1, 0, 7, [&](std::size_t) { ++here; });
  aligned.for_each_near(100, 50, 1, 0, 7, [&](std::size_t) { ++there; });
  EXPECT_EQ(here, 1) << "it is looked for where it is now";
  EXPECT_EQ(there, 0);
  // What is aligned stays so.
  EXPECT_TRUE(aligned.with_aligned({}).is_aligned(0));
  EXPECT_TRUE(aligned.with_priors(std::vector<kys::Prior>(2)).is_aligned(0));
}

TEST(SortUnique, GivesWhatASetGives) {
  std::mt19937 random(3);
  for (const std::uint32_t range : {1u, 64u, 1000u, 4000000000u}) {  // dense: by bits; else sorted
    for (const std::size_t count : {std::size_t{0}, std::size_t{1}, std::size_t{500}}) {
      std::vector<LandmarkId> ids;
      while (ids.size() < count) {
        ids.push_back({100 + static_cast<std::uint32_t>(random()) % range});
      }
      const std::set<LandmarkId> expected(ids.begin(), ids.end());
      sort_unique(ids);
      EXPECT_EQ(ids, std::vector<LandmarkId>(expected.begin(), expected.end())) << range;
    }
  }
}

TEST(FrameFeatures, RefusesAChoiceOfAnotherLength) {
  const auto features = testing::random_features(testing::kitti_camera(), 5, 1);
  EXPECT_THROW((void)features->subset(std::vector<std::uint8_t>(4, 1)), std::logic_error);
  EXPECT_EQ(features->subset(std::vector<std::uint8_t>(5, 0)).size(), 0u);
}

TEST(FrameFeatures, RefusesArraysOfUnequalLength) {
  const StereoCamera camera = testing::kitti_camera();
  FeatureSet set;
  set.keypoints.resize(2);
  set.descriptors.resize(2);
  EXPECT_THROW(FrameFeatures(camera, set, RightPositions({1.0f}), {}), std::logic_error);
  EXPECT_THROW(FrameFeatures(camera, set, RightPositions({1.0f, 2.0f}), std::vector<kys::Prior>(1)),
               std::logic_error);
  set.descriptors.resize(1);
  EXPECT_THROW(FrameFeatures(camera, set, RightPositions({1.0f, 2.0f}), {}), std::logic_error);
}

}  // namespace
}  // namespace kys_slam
