// SPDX-License-Identifier: BSD-3-Clause
#include "decision_errors.h"

#include <gtest/gtest.h>
#include <kys/belief.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/read_bytes.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
namespace pf = prior_format;

constexpr int kWidth = 60, kHeight = 40;
constexpr std::uint16_t kMover = 1, kParkedCar = 2, kWalker = 3, kStander = 4, kBuilding = 5;

std::string name_of(int frame) {
  char text[32];
  std::snprintf(text, sizeof text, "%06d.kysp", frame);
  return text;
}

class DecisionErrorsTest : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("kys_decision_errors_test_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    fs::create_directories(root_ / "in");
  }
  void TearDown() override { fs::remove_all(root_); }

  /// Each camera: a moving car (8x6 px at 10,10 + frame), a parked car, a walking and a standing
  /// person, a building everywhere else. mu on movers is 30 + row.
  static FramePriors frame_priors(int frame) {
    const kys::LabelSpace labels = kys::load_label_space("coco_panoptic_133");
    FramePriors priors;
    priors.label_space = labels.name();
    priors.has_motion = true;
    for (int side = 0; side < 2; ++side) {
      const std::int32_t base = side * pf::kRightInstances + 65536;
      const std::uint16_t car = labels.index_of("car"), person = labels.index_of("person");
      CameraPriors camera;
      camera.segments = {
          {car, pf::kThing | pf::kDynamic, base + 1, 100, 60, 0},
          {car, pf::kThing, base + 2, 100, 0, 0},
          {person, pf::kThing | pf::kDynamic | pf::kRadialOnly, base + 3, 50, 40, 0},
          {person, pf::kThing, base + 4, 50, 0, 0},
          {labels.index_of("building-other-merged"), 0, base - 65536 + 7, 1000, 0, 0}};
      camera.segment_map = ImageOf<std::uint16_t>(kWidth, kHeight, kBuilding);
      camera.motion = ImageOf<float>(kWidth, kHeight, 0.0F);
      fill(camera, kMover, 10 + frame % 5, 10, 8, 6);
      fill(camera, kParkedCar, 40, 10, 10, 8);
      fill(camera, kWalker, 10, 28, 3, 6);
      fill(camera, kStander, 50, 28, 3, 6);
      priors.cameras.push_back(camera);
    }
    return priors;
  }
  static void fill(CameraPriors& camera, std::uint16_t segment, int x0, int y0, int w, int h) {
    for (int y = y0; y < y0 + h; ++y) {
      for (int x = x0; x < x0 + w; ++x) {
        camera.segment_map.at(x, y) = segment;
        if (camera.segments[segment - 1u].flags & pf::kDynamic) {
          camera.motion.at(x, y) = 30.0F + static_cast<float>(y);
        }
      }
    }
  }

  void write_folder(int frames) const {
    for (int i = 0; i < frames; ++i) {
      const std::string path = (root_ / "in" / name_of(i)).string();
      write_file_atomic(path, encode_priors(frame_priors(i), path), Durable::kNo);
    }
  }
  DecisionErrorCounts disturb(DecisionError error, std::uint64_t seed = 1,
                              const std::string& out = "out") const {
    fs::remove_all(root_ / out);
    return disturb_decisions(root_ / "in", root_ / out, error, seed);
  }
  [[nodiscard]] FramePriors read(const std::string& folder, int frame) const {
    return decode_priors(PriorFile::open(root_ / folder / name_of(frame)));
  }
  static bool moving(const CameraPriors& camera, std::uint16_t segment) {
    return (camera.segments[segment - 1u].flags & pf::kDynamic) != 0;
  }

  fs::path root_;
};

TEST_F(DecisionErrorsTest, ParkedCallsVehiclesMovingAndNoPersons) {
  write_folder(2);
  const DecisionErrorCounts counts = disturb(DecisionError::kParked);
  EXPECT_EQ(counts.things, 16u);
  EXPECT_EQ(counts.moving_before, 8u);
  EXPECT_EQ(counts.moving_after, 12u);
  const FramePriors before = read("in", 1), after = read("out", 1);
  for (std::size_t side = 0; side < 2; ++side) {
    const CameraPriors& camera = after.cameras[side];
    EXPECT_TRUE(moving(camera, kMover) && moving(camera, kParkedCar) && moving(camera, kWalker));
    EXPECT_FALSE(moving(camera, kStander) || moving(camera, kBuilding));
    EXPECT_FLOAT_EQ(camera.motion.at(42, 12), 100);
    EXPECT_EQ(camera.segments[kParkedCar - 1u].score, 100);
    // What was called moving stays exactly as it was.
    EXPECT_EQ(camera.segments[kMover - 1u], before.cameras[side].segments[kMover - 1u]);
    EXPECT_EQ(camera.motion.at(12, 12), before.cameras[side].motion.at(12, 12));
  }
  EXPECT_TRUE(after.has_motion);
}

TEST_F(DecisionErrorsTest, BlindAndSegmentsOnlyDifferInWhetherMotionWasJudged) {
  write_folder(1);
  EXPECT_EQ(disturb(DecisionError::kBlind).moving_after, 0u);
  const FramePriors blind = read("out", 0);
  EXPECT_EQ(disturb(DecisionError::kSegmentsOnly).moving_after, 0u);
  const FramePriors unjudged = read("out", 0);
  EXPECT_TRUE(blind.has_motion);
  EXPECT_FALSE(unjudged.has_motion);
  const FramePriors before = read("in", 0);
  for (const FramePriors* after : {&blind, &unjudged}) {
    for (std::size_t side = 0; side < 2; ++side) {
      const CameraPriors& camera = after->cameras[side];
      for (std::size_t k = 0; k < 5; ++k) {
        const PriorSegment& a = before.cameras[side].segments[k];
        EXPECT_EQ(camera.segments[k].label, a.label);
        EXPECT_EQ(camera.segments[k].instance, a.instance);
        EXPECT_EQ(camera.segments[k].area, a.area);
        EXPECT_EQ(camera.segments[k].score, 0);
        EXPECT_EQ(camera.segments[k].flags, a.flags & pf::kThing);
      }
    }
  }
}

TEST_F(DecisionErrorsTest, BlindLooksJudgedAndSegmentsOnlyDoesNot) {
  write_folder(1);
  Keypoint on_mover, on_building;
  on_mover.x = on_mover.y = 12;
  on_building.x = on_building.y = 1;
  const std::vector<Keypoint> keypoints = {on_mover, on_building};
  const kys::InitialBelief start({}, kys::load_label_space("coco_panoptic_133"));
  const kys::BeliefOptions belief;
  for (const DecisionError error : {DecisionError::kBlind, DecisionError::kSegmentsOnly}) {
    const bool judged = error == DecisionError::kBlind;
    disturb(error);
    const PriorFile file = PriorFile::open(root_ / "out" / name_of(0));
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      std::vector<kys::Prior> priors(keypoints.size());
      file.lookup(side, keypoints, priors);
      for (const kys::Prior& prior : priors) EXPECT_EQ(prior.unjudged, judged ? 0 : 1);
      for (const kys::Prior& prior : file.segment_priors(side)) {
        EXPECT_EQ(prior.unjudged, judged ? 0 : 1);
      }
      EXPECT_DOUBLE_EQ(start.log_odds(priors[0]), belief.mobile + (judged ? belief.unflagged : 0));
    }
  }
}

TEST(SetMoving, WhatMovesIsJudged) {
  CameraPriors camera;
  camera.segments = {{2, pf::kThing | pf::kNotJudged, 65537, 100, 0, 0}};
  camera.segment_map = ImageOf<std::uint16_t>(4, 3, 1);
  set_moving(camera, 0, true);
  EXPECT_EQ(camera.segments[0].flags, pf::kThing | pf::kDynamic);
}

TEST(KeptFrames, ThirtyPercentAreMissingInRunsOfOneToEight) {
  std::map<std::size_t, int> lengths;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const std::vector<bool> kept = kept_frames(100, seed);
    ASSERT_EQ(kept.size(), 100u);
    EXPECT_EQ(std::count(kept.begin(), kept.end(), false), 30);
    std::size_t run = 0;
    for (std::size_t i = 0; i <= kept.size(); ++i) {
      if (i < kept.size() && !kept[i]) {
        ++run;
      } else if (run > 0) {
        ++lengths[run];
        run = 0;
      }
    }
  }
  EXPECT_EQ(lengths.begin()->first, 1u);
  EXPECT_EQ(lengths.rbegin()->first, 8u);
  EXPECT_EQ(lengths.size(), 8u);
  EXPECT_EQ(kept_frames(100, 3), kept_frames(100, 3));
  EXPECT_NE(kept_frames(100, 3), kept_frames(100, 4));
  EXPECT_EQ(kept_frames(1, 1), std::vector<bool>{true});
  for (std::size_t n = 1; n < 40; ++n) EXPECT_EQ(kept_frames(n, 9).size(), n);
}

TEST_F(DecisionErrorsTest, DropLeavesTheOtherFilesAsTheyWere) {
  write_folder(40);
  const DecisionErrorCounts counts = disturb(DecisionError::kDrop, 5);
  EXPECT_EQ(counts.files, 40u);
  EXPECT_EQ(counts.written, 28u);
  const std::vector<bool> kept = kept_frames(40, 5);
  for (int i = 0; i < 40; ++i) {
    EXPECT_EQ(fs::exists(root_ / "out" / name_of(i)), kept[static_cast<std::size_t>(i)]);
    if (!kept[static_cast<std::size_t>(i)]) continue;
    const FramePriors a = read("in", i), b = read("out", i);
    EXPECT_EQ(a.cameras[1].segments, b.cameras[1].segments);
    for (std::size_t p = 0; p < a.cameras[0].motion.size(); ++p) {
      ASSERT_EQ(a.cameras[0].motion.data()[p], b.cameras[0].motion.data()[p]);
    }
  }
}

TEST_F(DecisionErrorsTest, FlipHoldsForTenFramesAndHitsThirtyPercent) {
  write_folder(20);
  int wrong = 0, decisions = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    disturb(DecisionError::kFlip, seed);
    for (const int begin : {0, 10}) {
      const FramePriors first = read("out", begin), last = read("out", begin + 9);
      for (std::size_t side = 0; side < 2; ++side) {
        for (const std::uint16_t k : {kMover, kParkedCar, kWalker, kStander}) {
          const bool truth = k == kMover || k == kWalker;
          EXPECT_EQ(moving(first.cameras[side], k), moving(last.cameras[side], k));
          wrong += moving(first.cameras[side], k) != truth ? 1 : 0;
          ++decisions;
        }
        EXPECT_FALSE(moving(first.cameras[side], kBuilding));
      }
    }
  }
  EXPECT_EQ(decisions, 480);
  EXPECT_NEAR(wrong / 480.0, 0.3, 3 * std::sqrt(0.3 * 0.7 / 480));
}

TEST_F(DecisionErrorsTest, LateGivesTheFileOfTheFrameBefore) {
  write_folder(4);
  EXPECT_EQ(disturb(DecisionError::kLate).written, 3u);
  EXPECT_FALSE(fs::exists(root_ / "out" / name_of(0)));
  for (int i = 1; i < 4; ++i) {
    const FramePriors now = read("in", i), before = read("in", i - 1), out = read("out", i);
    EXPECT_EQ(out.cameras[0].segment_map.at(10 + i - 1, 12), kMover);
    EXPECT_EQ(now.cameras[0].segment_map.at(10 + i - 1, 12), kBuilding);
    EXPECT_EQ(out.cameras[0].segments, before.cameras[0].segments);
  }
}

TEST_F(DecisionErrorsTest, TheFrameBeforeTenIsNine) {
  write_folder(12);
  const auto short_name = [](int i) { return std::to_string(i) + ".kysp"; };
  for (int i = 0; i < 12; ++i) {
    fs::rename(root_ / "in" / name_of(i), root_ / "in" / short_name(i));
  }
  disturb(DecisionError::kLate);
  for (int i = 1; i < 12; ++i) {
    EXPECT_EQ(read_bytes(root_ / "out" / short_name(i)),
              read_bytes(root_ / "in" / short_name(i - 1)))
        << i;
  }
}

TEST_F(DecisionErrorsTest, BleedCoversADiscOfEightPixels) {
  write_folder(1);
  disturb(DecisionError::kBleed);
  const FramePriors before = read("in", 0), after = read("out", 0);
  const CameraPriors& camera = after.cameras[0];
  // The mover covers x 10..17, y 10..15, the walker x 10..12, y 28..33.
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const auto square = [&](int x0, int x1, int y0, int y1) {
        const int dx = std::max({x0 - x, 0, x - x1}), dy = std::max({y0 - y, 0, y - y1});
        return dx * dx + dy * dy;
      };
      const int to_mover = square(10, 17, 10, 15), to_walker = square(10, 12, 28, 33);
      const std::uint16_t now = camera.segment_map.at(x, y);
      const std::uint16_t was = before.cameras[0].segment_map.at(x, y);
      if (std::min(to_mover, to_walker) > 64) {
        EXPECT_EQ(now, was) << x << " " << y;
      } else if (to_mover < to_walker) {
        EXPECT_EQ(now, kMover) << x << " " << y;
        EXPECT_NEAR(camera.motion.at(x, y), 30.0 + std::clamp(y, 10, 15), 1.0);
      } else if (to_walker < to_mover) {
        EXPECT_EQ(now, kWalker) << x << " " << y;
      }
    }
  }
  const PriorSegment& a = before.cameras[0].segments[0];
  const PriorSegment& b = camera.segments[0];
  EXPECT_GT(b.area, a.area * 3);
  EXPECT_NEAR(b.scale / a.scale, static_cast<double>(b.area) / a.area, 1e-4);
}

TEST_F(DecisionErrorsTest, SameSeedSameBytes) {
  write_folder(12);
  disturb(DecisionError::kFlip, 4, "a");
  disturb(DecisionError::kFlip, 4, "b");
  for (int i = 0; i < 12; ++i) {
    std::ifstream a(root_ / "a" / name_of(i), std::ios::binary);
    std::ifstream b(root_ / "b" / name_of(i), std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(a)), {});
    EXPECT_FALSE(bytes.empty());
    EXPECT_EQ(bytes, std::string((std::istreambuf_iterator<char>(b)), {}));
  }
}

TEST_F(DecisionErrorsTest, BadInputIsAnError) {
  EXPECT_THROW(disturb(DecisionError::kBlind), InputError);  // no files
  write_folder(2);
  disturb(DecisionError::kBlind);
  EXPECT_THROW(disturb_decisions(root_ / "in", root_ / "out", DecisionError::kBlind, 1),
               InputError);  // files of another run are in the way
  EXPECT_THROW(disturb_decisions(root_ / "in", root_ / "in", DecisionError::kBlind, 1), InputError);
  std::ofstream(root_ / "in" / name_of(1)) << "damaged";
  EXPECT_THROW(disturb(DecisionError::kDrop), InputError);
  EXPECT_THROW(parse_decision_error("parket"), InputError);
  for (const std::string& name : decision_error_names()) {
    EXPECT_EQ(decision_error_names()[static_cast<std::size_t>(parse_decision_error(name))], name);
  }
}

}  // namespace
}  // namespace kys_slam
