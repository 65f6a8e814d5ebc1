// SPDX-License-Identifier: BSD-3-Clause
// Maps that are saved, loaded, extended and localised in, through the public interface.
#include <gtest/gtest.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/logic_error.h>
#include <kys_slam/system.h>

#include <cmath>
#include <map>
#include <set>

#include "io/temporary_folder.h"
#include "map/map.h"
#include "map_file/map_file.h"
#include "support/feature_world.h"
#include "system/private_access.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::weaving_pose;

FeatureWorld road() {
  FeatureWorld::Options options;
  options.pixel_noise = 0.4;
  options.flipped_bits = 12;
  options.length = 220;
  options.points = 16000;
  options.max_distance = 40;
  return {kitti_camera(), options};
}

class SavedMapTest : public ::testing::TestWithParam<Schedule> {
 protected:
  SavedMapTest() : world_(road()) {
    // The first run: 0 to 80 m.
    System system(world_.camera(), Settings(), Schedule::kSequential);
    for (int i = 0; i < 100; ++i) system.feed(world_.look(i, weaving_pose(0.8 * i)));
    system.finish();
    system.save_map(file());
    keyframes_ = map_of(system).keyframes().size();
  }
  [[nodiscard]] std::filesystem::path file() const { return folder_.path() / "road.map"; }
  /// Frame `i` of a later run, with other noise.
  [[nodiscard]] StereoFrame later(int i, double metres) const {
    StereoFrame frame = world_.look(5000 + i, weaving_pose(metres));
    frame.index = i;
    frame.timestamp = 0.1 * i;
    return frame;
  }
  /// Largest distance from the truth; the map's world is that of the first run's first frame.
  static double error(const FrameEstimate& estimate, double metres) {
    const Rigid3 truth = weaving_pose(0).inverse() * weaving_pose(metres);
    return (estimate.T_w_c.t() - truth.t()).norm();
  }

  FeatureWorld world_;
  TemporaryFolder folder_;
  std::size_t keyframes_ = 0;
};

TEST_P(SavedMapTest, LocalisesInAFrozenMap) {
  const std::vector<std::uint8_t> before = encode_map(load_map(file()));
  System system(world_.camera(), Settings(), GetParam());
  system.load_map(file(), true);
  for (int i = 0; i < 60; ++i) system.feed(later(i, 20 + 0.8 * i));
  system.finish();
  for (int i = 0; i < 60; ++i) {
    const FrameEstimate estimate = system.trajectory()[static_cast<std::size_t>(i)];
    ASSERT_TRUE(estimate.connected)
        << i << ": " << system.reports()[static_cast<std::size_t>(i)].reason;
    EXPECT_LT(error(estimate, 20 + 0.8 * i), 0.15) << "m, in the saved map's frame";
  }
  EXPECT_EQ(encode_map(map_of(system)), before) << "the map is as it was";
  EXPECT_TRUE(system.keyframes().empty()) << "none were made";
}

TEST_P(SavedMapTest, AFrozenMapIsNotExtendedWhereItEnds) {
  System system(world_.camera(), Settings(), GetParam());
  system.load_map(file(), true);
  for (int i = 0; i < 40; ++i) system.feed(later(i, 150 + 0.8 * i));
  system.finish();
  for (const FrameEstimate& estimate : system.trajectory()) EXPECT_FALSE(estimate.connected);
  EXPECT_EQ(map_of(system).keyframes().size(), keyframes_);
}

TEST_P(SavedMapTest, GoesOnMapping) {
  System system(world_.camera(), Settings(), GetParam());
  system.load_map(file());
  for (int i = 0; i < 120; ++i) system.feed(later(i, 40 + 0.8 * i));
  system.finish();
  map_of(system).check_consistency();
  EXPECT_GT(map_of(system).keyframes().size(), keyframes_ + 5);
  EXPECT_GT(system.keyframes().size(), 5u);
  for (int i = 0; i < 120; ++i) {
    const FrameEstimate estimate = system.trajectory()[static_cast<std::size_t>(i)];
    ASSERT_TRUE(estimate.connected) << i;
    EXPECT_LT(error(estimate, 40 + 0.8 * i), 0.4) << "m, in the saved map's frame";
  }
  const std::filesystem::path again = folder_.path() / "longer.map";
  system.save_map(again);
  EXPECT_EQ(load_map(again).keyframes().size(), map_of(system).keyframes().size());
}

/// A run that begins elsewhere makes a sub-map and joins when it comes to the known place.
TEST_P(SavedMapTest, ARunThatBeginsElsewhereJoinsLater) {
  System system(world_.camera(), Settings(), GetParam());
  system.load_map(file());
  for (int i = 0; i < 130; ++i) system.feed(later(i, 140 - 0.8 * i));
  system.finish();
  map_of(system).check_consistency();
  int merged = 0;
  for (const FrameReport& report : system.reports()) {
    merged += report.loop == LoopEvent::kMerged ? 1 : 0;
    EXPECT_EQ(report.loop_frame, -1) << "no frame of this run";
  }
  EXPECT_EQ(merged, 1);
  for (int i = 20; i < 130; ++i) {
    const FrameEstimate estimate = system.trajectory()[static_cast<std::size_t>(i)];
    ASSERT_TRUE(estimate.connected) << i;
    EXPECT_LT(error(estimate, 140 - 0.8 * i), 0.5) << "m, in the saved map's frame";
  }
}

TEST_P(SavedMapTest, IsSavedWhileTheRunGoesOn) {
  const std::filesystem::path early = folder_.path() / "early.map";
  std::vector<std::uint8_t> ends[2];
  for (const bool saves : {false, true}) {
    System system(world_.camera(), Settings(), GetParam());
    for (int i = 0; i < 60; ++i) {
      system.feed(later(i, 0.8 * i));
      if (saves && i == 40) system.save_map(early);
    }
    system.finish();
    ends[saves ? 1 : 0] = encode_map(map_of(system));
  }
  EXPECT_EQ(ends[0], ends[1]) << "the run does not notice";
  System system(world_.camera(), Settings(), GetParam());
  system.load_map(early, true);
  for (int i = 0; i < 10; ++i) system.feed(later(100 + i, 8 + 0.8 * i));
  system.finish();
  EXPECT_LT(error(system.trajectory().back(), 8 + 0.8 * 9), 0.15);
}

INSTANTIATE_TEST_SUITE_P(Schedules, SavedMapTest,
                         ::testing::Values(Schedule::kSequential, Schedule::kPipelined),
                         [](const auto& schedule) { return to_string(schedule.param); });

/// What was made of the first map would mix with the second.
TEST(SavedMap, ASecondOneIsRefused) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.map";
  const FeatureWorld world = road();
  System first(kitti_camera(), Settings(), Schedule::kSequential);
  first.feed(world.look(0, weaving_pose(0)));
  first.finish();
  first.save_map(file);
  System second(kitti_camera(), Settings(), Schedule::kSequential);
  second.load_map(file);
  EXPECT_THROW(second.load_map(file), LogicError);
}

TEST(SavedMap, OfAnotherCameraOrPyramidIsRefusedInOneLine) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.map";
  System first(kitti_camera(), Settings(), Schedule::kSequential);
  const FeatureWorld world = road();
  first.feed(world.look(0, weaving_pose(0)));
  first.finish();
  first.save_map(file);
  const auto refused = [&](const StereoCamera& camera, const Settings& settings) -> std::string {
    System system(camera, settings, Schedule::kSequential);
    try {
      system.load_map(file);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  StereoCamera other = kitti_camera();
  other.baseline = 0.12;
  const std::string told = refused(other, Settings());
  EXPECT_TRUE(told.starts_with(file.string() + ": the map was made with another camera")) << told;
  EXPECT_NE(told.find("baseline 0.12 m"), std::string::npos) << told;
  Settings levels;
  levels.set("orb.levels", "6");
  EXPECT_NE(refused(kitti_camera(), levels).find("pyramid levels"), std::string::npos);
  EXPECT_EQ(refused(kitti_camera(), Settings()), "");
}

/// A parked car fills the left third of the images, the rest is road. `build_priors` numbers the
/// things of every recording anew, so all of them have car 3.
class ParkedCar : public PriorProvider {
 public:
  static constexpr std::uint16_t kCar = 2;
  static constexpr std::int32_t kInstance = 3;
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override {
    (void)frame;
    fill(left, left_priors);
    fill(right, right_priors);
    return true;
  }

 private:
  static void fill(std::span<const Keypoint> keypoints, std::vector<kys::Prior>& priors) {
    constexpr std::uint16_t kRoad = 100;
    const kys::Prior car = kys::make_prior(kCar, kInstance, 5000.0f, 0.0f, false);
    const kys::Prior road = kys::make_prior(kRoad, kRoad, 5000.0f, 0.0f, false);
    priors.clear();
    for (const Keypoint& k : keypoints) priors.push_back(k.x < 400 ? car : road);
  }
};

class MapWithBeliefs : public ::testing::Test {
 protected:
  [[nodiscard]] System of_mode(const std::string& mode) const {
    Settings settings;
    settings.set("kys.mode", mode);
    return {world_.camera(), settings, Schedule::kSequential, std::make_unique<ParkedCar>()};
  }
  /// Feeds this many frames and saves the map to file().
  void run(System& system, int frames) const {
    for (int i = 0; i < frames; ++i) system.feed(world_.look(i, weaving_pose(0.8 * i)));
    system.finish();
    system.save_map(file());
  }
  [[nodiscard]] std::filesystem::path file() const { return folder_.path() / "car.map"; }
  static std::map<std::uint32_t, MapSnapshot::Landmark> on_cars(const System& system) {
    std::map<std::uint32_t, MapSnapshot::Landmark> result;
    for (const MapSnapshot::Landmark& landmark : system.snapshot().landmarks) {
      if (landmark.label == ParkedCar::kCar) result[landmark.id] = landmark;
    }
    return result;
  }

  const FeatureWorld world_ = road();

 private:
  const TemporaryFolder folder_;
};

TEST_F(MapWithBeliefs, ALoadedMapBelievesWhatTheSavedOneDidAndItsCarsAreOthers) {
  System first = of_mode("verified");
  run(first, 30);
  const auto saved = on_cars(first);
  ASSERT_GT(saved.size(), 100u);
  int believed = 0;
  for (const auto& [id, landmark] : saved) {
    EXPECT_EQ(landmark.instance, ParkedCar::kInstance);
    believed += landmark.belief > 0.95f ? 1 : 0;
  }
  EXPECT_GT(2 * believed, static_cast<int>(saved.size())) << "no prior file says that much";

  System second = of_mode("verified");
  second.load_map(file());
  const auto loaded = on_cars(second);
  ASSERT_EQ(loaded.size(), saved.size());
  for (const auto& [id, landmark] : saved) {
    ASSERT_TRUE(loaded.contains(id));
    EXPECT_EQ(loaded.at(id).belief, landmark.belief) << "landmark " << id;
    EXPECT_EQ(loaded.at(id).instance, landmark.instance);
  }
  std::set<std::int32_t> seen;
  second.set_observer([&](const FrameObservation& frame) {
    for (const ObservedInstance& instance : frame.instances) seen.insert(instance.instance);
  });
  for (int i = 0; i < 20; ++i) {
    StereoFrame frame = world_.look(5000 + i, weaving_pose(20 + 0.8 * i));
    frame.index = i;
    frame.timestamp = 0.1 * i;
    second.feed(frame);
  }
  second.finish();
  EXPECT_FALSE(seen.empty());
  EXPECT_FALSE(seen.contains(ParkedCar::kInstance)) << "the car of today is not that of yesterday";
  for (const FrameEstimate& estimate : second.trajectory()) EXPECT_TRUE(estimate.connected);
}

TEST_F(MapWithBeliefs, WhatIsUndecidedIsNotGatedInAModeWithoutBeliefs) {
  System first = of_mode("verified");
  run(first, 2);
  const auto saved = on_cars(first);
  ASSERT_GT(saved.size(), 50u);
  for (const auto& [id, landmark] : saved) {
    EXPECT_GT(landmark.belief, 0.5f);
    EXPECT_LT(landmark.belief, 0.8f) << "100 (1 - p) read as mu would be above the gate of 20";
  }

  System second = of_mode("kys");
  second.load_map(file());
  const auto loaded = on_cars(second);
  ASSERT_EQ(loaded.size(), saved.size());
  for (const auto& [id, landmark] : loaded) {
    EXPECT_EQ(landmark.belief, 1.0f);
    EXPECT_EQ(map_of(second).landmark(LandmarkId{id}).prior.motion, 0.0f) << id;
  }
  for (const KeyFrameId id : map_of(second).keyframes().ids()) {
    for (const kys::Prior& prior : map_of(second).keyframe(id).features->priors()) {
      EXPECT_EQ(prior.motion, 0.0f);
    }
  }
}

TEST_F(MapWithBeliefs, MuOfASavedMapBecomesTheBeliefOfItsClass) {
  System first = of_mode("kys");
  run(first, 5);

  System second = of_mode("verified");
  second.load_map(file());
  const auto loaded = on_cars(second);
  ASSERT_GT(loaded.size(), 50u);
  for (const auto& [id, landmark] : loaded) {
    EXPECT_NEAR(landmark.belief, 1 / (1 + std::exp(-1.0)), 1e-6) << "a car, not flagged: 0.5 + 0.5";
  }
  for (const MapSnapshot::Landmark& landmark : second.snapshot().landmarks) {
    if (landmark.label == ParkedCar::kCar) continue;
    EXPECT_EQ(landmark.belief, 1.0f);
  }
}

std::string refusal_of(System& system, const std::filesystem::path& file, bool localize_only) {
  try {
    system.load_map(file, localize_only);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST_F(MapWithBeliefs, LabelsBeyondTheLabelSpaceAreRefused) {
  System first = of_mode("verified");
  run(first, 2);
  MapContents contents = map_of(first).contents();
  for (Landmark& landmark : contents.landmarks) landmark.prior.label = 132;
  save_map(Map(contents), file(), "coco_panoptic_133");
  System last = of_mode("verified");
  EXPECT_EQ(refusal_of(last, file(), false), "");
  contents.landmarks.back().prior.label = 133;
  save_map(Map(contents), file(), "coco_panoptic_133");
  for (const char* mode : {"verified", "stock"}) {
    System system = of_mode(mode);
    EXPECT_EQ(refusal_of(system, file(), false),
              file().string() + ": label 133 is not in label space coco_panoptic_133");
  }
}

TEST(SavedMap, WithoutKeyframesNothingIsFoundInIt) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "empty.map";
  System system(kitti_camera(), Settings(), Schedule::kSequential);
  save_map(map_of(system), file);
  EXPECT_EQ(refusal_of(system, file, true), file.string() + ": holds no keyframes");
  EXPECT_EQ(refusal_of(system, file, false), "") << "a map to begin with";
}

}  // namespace
}  // namespace kys_slam
