// SPDX-License-Identifier: BSD-3-Clause
#include "map_file/map_file.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <chrono>

#include "io/temporary_folder.h"
#include "map/replica.h"
#include "map_file/map_format.h"
#include "map_file/sample_map.h"
#include "support/rig_samples.h"

namespace kys_slam {
namespace {

using testing::kSampleLabelSpace;
using testing::sample_map;

template <typename T>
bool same_bits(const T& a, const T& b) {
  return std::memcmp(&a, &b, sizeof(T)) == 0;
}
bool same_pose(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

void expect_equal(const FrameFeatures& a, const FrameFeatures& b) {
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(a.priors().size(), b.priors().size());
  EXPECT_EQ(a.rig(), b.rig());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.keypoint(i), b.keypoint(i));
    EXPECT_EQ(a.descriptor(i), b.descriptor(i));
    EXPECT_EQ(a.prior(i), b.prior(i));
    EXPECT_TRUE(same_bits(a.u_right(i), b.u_right(i)) ||
                (std::isnan(a.u_right(i)) && std::isnan(b.u_right(i))));
    EXPECT_EQ(a.depth(i), b.depth(i));
  }
  std::vector<std::size_t> near_a;
  std::vector<std::size_t> near_b;
  a.for_each_near(600, 180, 100, 0, 7, [&](std::size_t i) { near_a.push_back(i); });
  b.for_each_near(600, 180, 100, 0, 7, [&](std::size_t i) { near_b.push_back(i); });
  EXPECT_EQ(near_a, near_b);
}

void expect_equal(const KeyFrame& a, const KeyFrame& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.submap, b.submap);
  EXPECT_EQ(a.frame_index, b.frame_index);
  EXPECT_EQ(a.timestamp, b.timestamp);
  EXPECT_TRUE(same_pose(a.T_c_w, b.T_c_w));
  EXPECT_EQ(a.landmarks, b.landmarks);
  EXPECT_EQ(a.covisible, b.covisible);
  EXPECT_EQ(a.parent, b.parent);
  EXPECT_EQ(a.children, b.children);
  EXPECT_EQ(a.loop_edges, b.loop_edges);
  expect_equal(*a.features, *b.features);
}

void expect_equal(const Landmark& a, const Landmark& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.p_w, b.p_w);
  EXPECT_EQ(a.normal, b.normal);
  EXPECT_EQ(a.min_distance, b.min_distance);
  EXPECT_EQ(a.max_distance, b.max_distance);
  EXPECT_EQ(a.descriptor, b.descriptor);
  EXPECT_EQ(a.prior, b.prior);
  EXPECT_EQ(a.reference, b.reference);
  EXPECT_EQ(a.first_keyframe, b.first_keyframe);
  EXPECT_EQ(a.visible, b.visible);
  EXPECT_EQ(a.found, b.found);
  EXPECT_EQ(a.observations, b.observations);
}

void expect_equal(const Map& a, const Map& b) {
  EXPECT_EQ(a.camera(), b.camera());
  EXPECT_EQ(a.scales().scale, b.scales().scale);
  EXPECT_EQ(a.scales().log_factor, b.scales().log_factor);
  EXPECT_EQ(a.rig(), b.rig());
  EXPECT_EQ(a.rig_estimate().covariance, b.rig_estimate().covariance);
  EXPECT_EQ(a.keyframe_id_end(), b.keyframe_id_end());
  EXPECT_EQ(a.landmark_id_end(), b.landmark_id_end());
  ASSERT_EQ(a.keyframes().ids(), b.keyframes().ids());
  ASSERT_EQ(a.landmarks().ids(), b.landmarks().ids());
  for (const KeyFrameId id : a.keyframes().ids()) expect_equal(a.keyframe(id), b.keyframe(id));
  for (const LandmarkId id : a.landmarks().ids()) expect_equal(a.landmark(id), b.landmark(id));
  for (std::uint32_t k = 0; k < a.keyframe_id_end(); ++k) {
    EXPECT_EQ(a.culled_parent({k}), b.culled_parent({k}));
    ASSERT_EQ(a.pose({k}).has_value(), b.pose({k}).has_value());
    if (a.pose({k})) {
      EXPECT_TRUE(same_pose(*a.pose({k}), *b.pose({k})));
    }
  }
}

TEST(MapFile, LoadedMapEqualsTheSavedOne) {
  const TemporaryFolder folder;
  for (const bool with_priors : {true, false}) {
    const Map map = sample_map(8, 60, with_priors);
    save_map(map, folder / "a.map", with_priors ? kSampleLabelSpace : "");
    const Map loaded = load_map(folder / "a.map", kSampleLabelSpace);
    expect_equal(map, loaded);
    loaded.check_consistency();
  }
}

TEST(MapFile, KeepsWhatIsAligned) {
  Map map(testing::kitti_camera(), ScaleLevels(1.2, 8));
  const auto found = testing::random_features(map.camera(), 20, 5);
  const Keypoint& k = found->keypoint(7);
  const std::vector<FrameFeatures::Aligned> places{{7, k.x + 0.25f, k.y - 0.5f}};
  map.add_keyframe(testing::make_keyframe(
      0, std::make_shared<const FrameFeatures>(found->with_aligned(places))));
  const Map loaded = parse_map(encode_map(map), "aligned");
  const FrameFeatures& features = *loaded.keyframe({0}).features;
  for (std::size_t i = 0; i < features.size(); ++i) EXPECT_EQ(features.is_aligned(i), i == 7);
  EXPECT_EQ(features.keypoint(7).x, k.x + 0.25f);
  EXPECT_EQ(encode_map(loaded), encode_map(map));
}

/// \return what a map of this extractor contains after it was written and read
ScaleLevels through_a_file(const ExtractorTraits& traits) {
  const Map map(testing::kitti_camera(), ScaleLevels(traits));
  const std::vector<std::uint8_t> bytes = encode_map(map);
  const Map loaded = parse_map(bytes, "extractor");
  EXPECT_EQ(encode_map(loaded), bytes);
  EXPECT_EQ(bytes[map_format::kAtVersion], traits.name == kOrbName ? 2 : 3);
  return loaded.scales();
}

TEST(MapFile, KeepsTheExtractor) {
  EXPECT_EQ(through_a_file({}).extractor, "orb");
  ExtractorTraits traits;
  traits.name = "mine:0123";
  traits.levels = 3;
  traits.sizes = false;
  traits.reach = 1.75;
  traits.pixel_sigma = 0.01;
  for (std::size_t i = 0; i < kMatchingShares.size(); ++i) {
    traits.distances.matching.push_back(static_cast<float>(3 * i));
  }
  for (std::size_t i = 0; i < kOtherShares.size(); ++i) {
    traits.distances.other.push_back(static_cast<float>(40 + 7 * i));
  }
  const ScaleLevels scales = through_a_file(traits);
  EXPECT_EQ(scales.extractor, "mine:0123");
  EXPECT_EQ(scales.levels(), 3);
  EXPECT_TRUE(scales.same_levels(ScaleLevels(traits)));
  EXPECT_EQ(scales.distances.matching, traits.distances.matching);
  EXPECT_EQ(scales.distances.other, traits.distances.other);
}

TEST(MapFile, RefusesAnExtractorThatMakesNoSense) {
  ExtractorTraits traits;
  traits.name = "x";
  std::vector<std::uint8_t> bytes = encode_map(Map(testing::kitti_camera(), ScaleLevels(traits)));
  // The last bytes: length and name, sizes, reach, standard deviation, whether there are distances.
  const std::size_t sizes = bytes.size() - 10, reach = bytes.size() - 9,
                    measured = bytes.size() - 1;
  const auto refused = [&](std::size_t at, std::uint8_t value, const std::string& what) {
    std::vector<std::uint8_t> damaged = bytes;
    damaged[at] = value;
    const std::uint32_t sum =
        map_format::checksum(std::span(damaged).subspan(map_format::kAtChecked));
    for (std::size_t i = 0; i < 4; ++i) {
      damaged[map_format::kAtChecksum + i] = static_cast<std::uint8_t>(sum >> (8 * i));
    }
    try {
      parse_map(std::move(damaged), "bad.map");
      ADD_FAILURE() << "taken: " << what;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("bad.map"), std::string::npos);
      EXPECT_NE(std::string(error.what()).find(what), std::string::npos) << error.what();
    }
  };
  refused(sizes, 7, "unknown flag");
  refused(reach + 3, 0xFF, "reach");  // negative
  refused(measured, 2, "unknown flag");
  refused(measured, 1, "truncated");
}

TEST(MapFile, KeepsWhetherMotionWasJudged) {
  Map map(testing::kitti_camera(), ScaleLevels(1.2, 8));
  std::vector<kys::Prior> priors;
  for (const bool judged : {false, true}) {
    priors.push_back(kys::make_prior(13, 1, 5, 0, false));
    priors.back().unjudged = judged ? 0 : 1;
  }
  const auto seen = testing::random_features(map.camera(), 2, 5);
  map.add_keyframe(
      testing::make_keyframe(0, std::make_shared<const FrameFeatures>(seen->with_priors(priors))));
  Landmark landmark = testing::make_landmark(0, {0, 0, 10});
  landmark.prior = priors[0];
  map.add_landmark(landmark);
  map.add_observation({0}, {0}, 0);
  const Map loaded = parse_map(encode_map(map, kSampleLabelSpace), "a", kSampleLabelSpace);
  EXPECT_EQ(loaded.keyframe({0}).features->prior(0), priors[0]);
  EXPECT_EQ(loaded.keyframe({0}).features->prior(1), priors[1]);
  EXPECT_EQ(loaded.landmark({0}).prior, priors[0]);
}

/// A camera that stays in one room: keyframes come and go, and ids of landmarks are not used again.
TEST(MapFile, OfALongRunInOnePlaceIsReadAgain) {
  Map map(testing::kitti_camera(), ScaleLevels(1.2, 8));
  constexpr std::uint32_t kKeyframes = 600;
  constexpr std::uint32_t kFeatures = 300;
  for (std::uint32_t k = 0; k < kKeyframes; ++k) {
    map.add_keyframe(testing::make_keyframe(
        k, testing::random_features(map.camera(), k == 0 ? 100 : kFeatures, 1, 1.0)));
    if (k == 0) continue;
    map.connect_to_spanning_tree({k}, {0});
    for (std::uint32_t f = 0; f < kFeatures; ++f) {
      const std::uint32_t id = 2 * (k * kFeatures + f);
      map.add_landmark(testing::make_landmark(id, {0, 0, 10}, {k}));
      map.add_observation({id}, {k}, f);
    }
    ASSERT_TRUE(map.cull_keyframe({k}));
  }
  EXPECT_NO_THROW(expect_equal(map, parse_map(encode_map(map), "room")));
}

TEST(MapFile, SavedAgainIsTheSameBytes) {
  const Map map = sample_map();
  const auto bytes = encode_map(map, kSampleLabelSpace);
  EXPECT_EQ(encode_map(map, kSampleLabelSpace), bytes);
  EXPECT_EQ(encode_map(parse_map(bytes, "a", kSampleLabelSpace), kSampleLabelSpace), bytes);
}

TEST(MapFile, SaysWhetherItsMotionIsBelief) {
  Map map = sample_map();
  const auto without = encode_map(map, kSampleLabelSpace);
  EXPECT_FALSE(parse_map(without, "a", kSampleLabelSpace).keeps_beliefs());
  map.keep_beliefs();
  auto with = encode_map(map, kSampleLabelSpace);
  const Map loaded = parse_map(with, "b", kSampleLabelSpace);
  EXPECT_TRUE(loaded.keeps_beliefs());
  EXPECT_EQ(encode_map(loaded, kSampleLabelSpace), with);
  with[map_format::kAtFlags] |= 2;
  byte_stream::ByteWriter sum;
  sum.u32(map_format::checksum(std::span(with).subspan(map_format::kAtChecked)));
  std::copy(sum.bytes().begin(), sum.bytes().end(), with.begin() + map_format::kAtChecksum);
  try {
    (void)parse_map(with, "c", kSampleLabelSpace);
    ADD_FAILURE() << "of a later program";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "c: has unknown flags");
  }
}

TEST(MapFile, EmptyMap) {
  const Map map(testing::kitti_camera(), ScaleLevels(1.2, 8));
  const Map loaded = parse_map(encode_map(map), "empty");
  expect_equal(map, loaded);
  EXPECT_EQ(encode_map(loaded), encode_map(map));
}

TEST(MapFile, FirstChangesMakeAFullReplica) {
  Map map = sample_map();
  Map loaded = parse_map(encode_map(map, kSampleLabelSpace), "a", kSampleLabelSpace);
  Replica replica;
  replica.apply(loaded.take_changes());
  EXPECT_EQ(replica.keyframes().ids(), map.keyframes().ids());
  EXPECT_EQ(replica.landmarks().ids(), map.landmarks().ids());
  for (const LandmarkId id : map.landmarks().ids()) {
    EXPECT_EQ(replica.landmarks().at(id), map.view(id));
  }
  for (const KeyFrameId id : map.keyframes().ids()) {
    EXPECT_EQ(replica.keyframes().at(id).neighbours, map.view(id).neighbours);
    EXPECT_EQ(replica.keyframes().at(id).landmarks, map.view(id).landmarks);
  }
  EXPECT_EQ(replica.resolve(KeyFrameId{2}).keyframe, map.culled_parent({2}));
  const ChangeSet second = loaded.take_changes();
  EXPECT_TRUE(second.keyframes.empty() && second.landmarks.empty());
}

TEST(MapFile, ALoadedMapGoesOn) {
  Map map = sample_map();
  Map loaded = parse_map(encode_map(map, kSampleLabelSpace), "a", kSampleLabelSpace);
  for (Map* m : {&map, &loaded}) {
    const std::uint32_t id = m->keyframe_id_end();
    m->add_keyframe(testing::make_keyframe(id, testing::features_with_priors(m->camera(), 60, 99),
                                           m->keyframe({1}).T_c_w));
    for (const LandmarkId l : m->landmarks().ids()) {
      if (m->submap(m->landmark(l).reference) != KeyFrameId{0} || l.value >= 60) continue;
      m->add_observation(l, {id}, l.value / 2);
      m->refresh_landmark(l);
    }
    m->connect_to_spanning_tree({id}, {0});
    EXPECT_TRUE(m->cull_keyframe({4}));
    m->erase_landmark({8});
    m->check_consistency();
  }
  expect_equal(map, loaded);
}

TEST(MapFile, PriorsMeanSomethingInTheirLabelSpaceOnly) {
  const auto bytes = encode_map(sample_map(), kSampleLabelSpace);
  expect_input_error([&] { parse_map(bytes, "a.map", "coco133"); },
                     {"a.map", "coco133", kSampleLabelSpace});
  expect_input_error([&] { parse_map(bytes, "a.map"); }, {"a.map", kSampleLabelSpace});
  EXPECT_NO_THROW(parse_map(encode_map(sample_map(8, 60, false), "x"), "a.map", "coco133"));
  EXPECT_THROW(encode_map(sample_map()), std::invalid_argument);
  EXPECT_THROW(encode_map(sample_map(), "two words"), std::invalid_argument);
  EXPECT_THROW(encode_map(sample_map(), std::string(256, 'x')), std::invalid_argument);
}

TEST(MapFile, FilesThatCannotBe) {
  const TemporaryFolder folder;
  expect_input_error([&] { load_map(folder / "absent.map"); }, {"absent.map", "No such file"});
  expect_input_error([&] { load_map(folder.path()); }, {"not a regular file"});
  expect_input_error([&] { save_map(sample_map(6, 20, false), folder / "no" / "such.map"); },
                     {"such.map", "No such file"});
}

/// The file lies in the tree: every later version of the program has to read it. It was written by
/// the disabled test below.
class FileOfVersion : public ::testing::TestWithParam<const char*> {};

TEST_P(FileOfVersion, StillOpens) {
  const Map map =
      load_map(std::string(KYS_SOURCE_DIR "/tests/map_file/data/") + GetParam(), kSampleLabelSpace);
  map.check_consistency();
  EXPECT_EQ(map.camera(), testing::kitti_camera());
  EXPECT_EQ(map.scales().levels(), 8);
  EXPECT_EQ(map.rig().offset(), 0.0625);
  EXPECT_EQ(map.keyframes().ids(), (std::vector<KeyFrameId>{{0}, {1}, {4}, {5}, {6}, {7}}));
  EXPECT_EQ(map.culled_parent({3}), KeyFrameId{2});
  EXPECT_EQ(map.landmarks().size(), 57u);
  EXPECT_FALSE(map.has(LandmarkId{2}));
  const KeyFrame& k = map.keyframe({6});
  EXPECT_EQ(k.frame_index, 42);
  EXPECT_EQ(k.submap, KeyFrameId{6});
  EXPECT_EQ(map.submap({2}), KeyFrameId{0});
  EXPECT_DOUBLE_EQ(k.timestamp, 0.1 * 6);
  EXPECT_NEAR(k.T_c_w.t().z(), -9.0, 1e-12);
  EXPECT_EQ(k.features->size(), 60u);
  EXPECT_EQ(k.features->priors().size(), 60u);
  EXPECT_EQ(map.keyframe({0}).loop_edges, (std::vector<KeyFrameId>{{1}, {5}}));
  const Landmark& l = map.landmark({20});
  EXPECT_NEAR(l.p_w.y(), 1.0 / 11, 1e-12);
  EXPECT_EQ(l.visible, 11u);
  // What the same program makes today is the same map.
  const Map today = sample_map();
  EXPECT_EQ(map.landmarks().ids(), today.landmarks().ids());
  for (const LandmarkId id : map.landmarks().ids()) {
    EXPECT_EQ(map.landmark(id).observations, today.landmark(id).observations);
    EXPECT_EQ(map.landmark(id).descriptor, today.landmark(id).descriptor);
    EXPECT_EQ(map.landmark(id).prior.label, today.landmark(id).prior.label);
    EXPECT_NEAR(map.landmark(id).max_distance, today.landmark(id).max_distance, 1e-3);
  }
}

INSTANTIATE_TEST_SUITE_P(MapFile, FileOfVersion,
                         ::testing::Values("version_1.map", "version_2.map"));

TEST(MapFile, KeepsWhatABentRigMeasured) {
  const StereoCamera camera = testing::kitti_like();
  FeatureSet set;
  set.keypoints = {{100.5f, 50, 0, 1, 0}, {900, 300.25f, 0, 1, 2}, {500, 20, 0, 1, 1}};
  set.descriptors.resize(3);
  RigEstimate rig(testing::bent_rig(camera));
  rig.covariance(8, 3) = rig.covariance(3, 8) = 1e-6;
  Map map(camera, ScaleLevels(1.2, 8));
  map.add_keyframe(testing::make_keyframe(
      0, std::make_shared<const FrameFeatures>(
             camera, set,
             RightPositions({90, testing::kNoStereo, 490}, {50.25f, testing::kNoStereo, 19}),
             std::vector<kys::Prior>{}, rig.correction)));
  map.set_rig(rig);
  const auto bytes = encode_map(map);
  const Map loaded = parse_map(bytes, "a.map");
  expect_equal(map, loaded);
  EXPECT_EQ(encode_map(loaded), bytes);
  const FrameFeatures& features = *loaded.keyframe({0}).features;
  EXPECT_EQ(features.measured(0), map.keyframe({0}).features->measured(0));
  EXPECT_NE(features.keypoint(1).x, 900);
}

TEST(MapFile, DISABLED_WriteTheFileOfThisVersion) {
  save_map(sample_map(), KYS_SOURCE_DIR "/tests/map_file/data/version_2.map", kSampleLabelSpace);
}

}  // namespace
}  // namespace kys_slam
