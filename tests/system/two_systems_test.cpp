// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/sequence.h>
#include <kys_slam/system.h>

#include <sstream>
#include <thread>

#include "map/map.h"
#include "support/small_sequence.h"
#include "system/private_access.h"

namespace kys_slam {
namespace {

std::vector<StereoFrame> small_frames() {
  const auto sequence = open_kitti_sequence(testing::small_sequence());
  std::vector<StereoFrame> frames;
  while (auto frame = sequence->next()) frames.push_back(std::move(*frame));
  return frames;
}

/// The same street seen in a mirror: another world for the second system.
std::vector<StereoFrame> mirrored(std::vector<StereoFrame> frames) {
  for (StereoFrame& frame : frames) {
    for (GrayImage* image : {&frame.left, &frame.right}) {
      for (int y = 0; y < image->height(); ++y) {
        std::reverse(image->row(y), image->row(y) + image->width());
      }
    }
    std::swap(frame.left, frame.right);
  }
  return frames;
}

Settings small_settings(const char* features) {
  Settings settings;
  settings.set("orb.features", features);
  settings.set("keyframes.reference_ratio", "0.97");
  return settings;
}

/// Everything a system knows at its end, bit by bit.
std::string fingerprint(const System& system) {
  std::ostringstream text;
  text << std::hexfloat;
  for (const FrameEstimate& e : system.trajectory()) {
    text << e.index << e.connected << e.T_w_c.rotation.coeffs().transpose() << "|"
         << e.T_w_c.translation.transpose() << "\n";
  }
  map_of(system).landmarks().for_each([&](LandmarkId id, const Landmark& l) {
    text << id.value << " " << l.p_w.transpose() << " " << l.observations.size() << "\n";
  });
  return text.str();
}

class TwoSystems : public ::testing::Test {
 protected:
  static std::string alone(const std::vector<StereoFrame>& frames, const Settings& settings,
                           Schedule schedule) {
    System system(testing::small_camera(), settings, schedule);
    for (const StereoFrame& frame : frames) system.feed(frame);
    system.finish();
    return fingerprint(system);
  }
  const std::vector<StereoFrame> street_ = small_frames();
  const std::vector<StereoFrame> mirror_ = mirrored(street_);
  const Settings first_ = small_settings("800");
  const Settings second_ = small_settings("500");
};

TEST_F(TwoSystems, FedInTurnsDoNotInfluenceEachOther) {
  for (const Schedule schedule : {Schedule::kSequential, Schedule::kPipelined}) {
    System a(testing::small_camera(), first_, schedule);
    System b(testing::small_camera(), second_, schedule);
    for (std::size_t i = 0; i < street_.size(); ++i) {
      a.feed(street_[i]);
      b.feed(mirror_[i]);
    }
    b.finish();
    a.finish();
    EXPECT_TRUE(fingerprint(a) == alone(street_, first_, schedule)) << to_string(schedule);
    EXPECT_TRUE(fingerprint(b) == alone(mirror_, second_, schedule)) << to_string(schedule);
    EXPECT_FALSE(fingerprint(a) == fingerprint(b));
  }
}

TEST_F(TwoSystems, InTwoThreadsDoNotInfluenceEachOther) {
  std::string a;
  std::string b;
  std::thread other([&] { b = alone(mirror_, second_, Schedule::kPipelined); });
  a = alone(street_, first_, Schedule::kPipelined);
  other.join();
  EXPECT_TRUE(a == alone(street_, first_, Schedule::kPipelined));
  EXPECT_TRUE(b == alone(mirror_, second_, Schedule::kPipelined));
}

TEST_F(TwoSystems, ASystemThrownAwayHalfWayLeavesNothingBehind) {
  const std::string before = alone(street_, first_, Schedule::kPipelined);
  {
    System abandoned(testing::small_camera(), first_, Schedule::kPipelined);
    for (std::size_t i = 0; i < 6; ++i) abandoned.feed(mirror_[i]);
  }
  EXPECT_TRUE(alone(street_, first_, Schedule::kPipelined) == before);
}

TEST_F(TwoSystems, FramesThatDoNotFitAreRefusedAndTheSystemGoesOn) {
  System system(testing::small_camera(), first_, Schedule::kSequential);
  system.feed(street_[0]);
  StereoFrame late = street_[1];
  late.timestamp = street_[0].timestamp;
  EXPECT_THROW(system.feed(late), InputError);
  late.timestamp = std::nan("");
  EXPECT_THROW(system.feed(late), InputError);
  StereoFrame small = street_[1];
  small.right = GrayImage(10, 10);
  EXPECT_THROW(system.feed(small), InputError);
  StereoFrame half = street_[1];
  half.left_features.emplace();
  EXPECT_THROW(system.feed(half), InputError);
  // Features that no table of the matchers has room for.
  StereoFrame fed = street_[1];
  fed.left = fed.right = {};
  fed.left_features.emplace();
  fed.right_features.emplace();
  for (FeatureSet* set : {&*fed.left_features, &*fed.right_features}) {
    const FeatureSet good{{{100, 50, 1, 30, 7}}, {{}}};
    for (const Keypoint bad : {Keypoint{100, 50, 1, 30, 8}, Keypoint{std::nanf(""), 50, 1, 30, 0},
                               Keypoint{100, 1e30F, 1, 30, 0}, Keypoint{100, 50, 270, 30, 0},
                               Keypoint{100, 50, std::nanf(""), 30, 0}}) {
      *set = {{bad}, {{}}};
      EXPECT_THROW(system.feed(fed), InputError) << bad.x << " " << bad.y << " " << bad.angle;
    }
    *set = {{{100, 50, 1, 30, 7}}, {}};
    EXPECT_THROW(system.feed(fed), InputError) << "a keypoint without a descriptor";
    set->keypoints.assign(65536, good.keypoints[0]);
    set->descriptors.resize(65536);
    EXPECT_THROW(system.feed(fed), InputError) << "too many";
    *set = good;
  }
  EXPECT_EQ(system.feed(street_[1]).status, FrameStatus::kTracked);
  system.finish();
  EXPECT_EQ(system.trajectory().size(), 2u) << "refused frames are not counted";
}

}  // namespace
}  // namespace kys_slam
