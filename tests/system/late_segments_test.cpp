// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/label_space.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "support/feature_world.h"

// Segmentations that come late and for some frames: a street with a van that drives ahead.

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::weaving_pose;

constexpr double kCameraStep = 0.8;  // m per frame, of the camera
constexpr double kVanStep = 0.75;    // of the van

class VanAhead {
 public:
  VanAhead() : world_(kitti_camera(), options()), van_(kitti_camera(), options(), van_points()) {}

  /// \param on_van if given, receives a flag per left feature
  [[nodiscard]] StereoFrame look(int i, std::vector<bool>* on_van = nullptr) const {
    const Rigid3 T_w_c = weaving_pose(kCameraStep * i);
    StereoFrame frame = world_.look(i, T_w_c);
    const StereoFrame van =
        van_.look(i, {T_w_c.rotation, T_w_c.t() - Eigen::Vector3d(0, 0, kVanStep * i)});
    const Box box = box_of(van);
    FeatureSet left = *van.left_features, right = *van.right_features;
    if (on_van != nullptr) on_van->assign(left.size(), true);
    for (std::size_t k = 0; k < frame.left_features->size(); ++k) {
      const Keypoint& keypoint = frame.left_features->keypoints[k];
      if (box.contains(keypoint.x, keypoint.y)) continue;  // the van hides it
      left.keypoints.push_back(keypoint);
      left.descriptors.push_back(frame.left_features->descriptors[k]);
      right.keypoints.push_back(frame.right_features->keypoints[k]);
      right.descriptors.push_back(frame.right_features->descriptors[k]);
      if (on_van != nullptr) on_van->push_back(false);
    }
    frame.left_features = std::move(left);
    frame.right_features = std::move(right);
    return frame;
  }
  /// \param instance that the network calls the van in this image
  [[nodiscard]] std::shared_ptr<SegmentImage> segments(int i, std::int32_t instance = 7) const {
    const Rigid3 T_w_c = weaving_pose(kCameraStep * i);
    const Box box =
        box_of(van_.look(i, {T_w_c.rotation, T_w_c.t() - Eigen::Vector3d(0, 0, kVanStep * i)}));
    auto image = std::make_shared<SegmentImage>();
    image->map = ImageOf<std::uint16_t>(kitti_camera().width, kitti_camera().height, 1);
    for (int y = 0; y < image->map.height(); ++y) {
      for (int x = 0; x < image->map.width(); ++x) {
        if (box.contains(static_cast<float>(x), static_cast<float>(y))) image->map.at(x, y) = 2;
      }
    }
    for (const std::uint16_t label : {building(), car()}) {
      kys::Prior& prior =
          image->segments.emplace_back(kys::make_prior(label, instance, 0, 0, false));
      prior.unjudged = 1;
    }
    return image;
  }
  [[nodiscard]] static std::uint16_t building() {
    return space().index_of("building-other-merged");
  }
  [[nodiscard]] static std::uint16_t car() { return space().index_of("car"); }

 private:
  struct Box {
    float left = 1e9f, top = 1e9f, right = -1, bottom = -1;  // px
    [[nodiscard]] bool contains(float x, float y) const {
      return x >= left && x <= right && y >= top && y <= bottom;
    }
  };
  static const kys::LabelSpace& space() {
    static const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
    return space;
  }
  static Box box_of(const StereoFrame& van) {
    Box box;
    for (const Keypoint& k : van.left_features->keypoints) {
      box = {std::min(box.left, k.x - 2), std::min(box.top, k.y - 2), std::max(box.right, k.x + 2),
             std::max(box.bottom, k.y + 2)};
    }
    return box;
  }
  static FeatureWorld::Options options() {
    FeatureWorld::Options options;
    options.length = 90;
    options.points = 8000;
    options.pixel_noise = 0.2;
    options.flipped_bits = 8;
    return options;
  }
  static std::vector<FeatureWorld::Point> van_points() {
    std::vector<FeatureWorld::Point> points;
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int i = 0; i < 150; ++i) {
      FeatureWorld::Point p;
      p.p_w = {1 + 1.2 * unit(random), 0.3 + unit(random), 12 + 0.5 * unit(random)};
      for (auto& word : p.descriptor.words) word = random();
      p.largest_distance = 25;
      p.angle = static_cast<float>(3.1 * (1 + unit(random)));
      points.push_back(p);
    }
    return points;
  }

  FeatureWorld world_, van_;
};

Settings with(int every, int lag, double timeout = 60) {
  Settings settings;
  settings.set("kys.mode", "verified");
  settings.set("control.segment_every", std::to_string(every));
  settings.set("control.segment_lag", std::to_string(lag));
  settings.set("control.segment_timeout", std::to_string(timeout));
  return settings;
}

std::vector<Rigid3> poses_of(const System& system) {
  std::vector<Rigid3> poses;
  for (const FrameEstimate& e : system.trajectory()) {
    EXPECT_TRUE(e.connected) << e.index;
    poses.push_back(e.T_w_c);
  }
  return poses;
}

bool same(const std::vector<Rigid3>& a, const std::vector<Rigid3>& b) {
  return std::ranges::equal(a, b, [](const Rigid3& x, const Rigid3& y) {
    return x.rotation.coeffs() == y.rotation.coeffs() && x.translation == y.translation;
  });
}

TEST(LateSegments, TakeEffectExactlyTheLagAfterTheirFrame) {
  const VanAhead street;
  System system(kitti_camera(), with(5, 3), Schedule::kSequential);
  for (int i = 0; i < 20; ++i) {
    if (i % 5 == 0) system.add_segments(i, street.segments(i));
    const FrameReport report = system.feed(street.look(i));
    EXPECT_EQ(report.segments_of, i >= 3 && (i - 3) % 5 == 0 ? i - 3 : -1) << i;
    EXPECT_EQ(report.status == FrameStatus::kLost, i < 3) << report.reason;
  }
  system.finish();
  // Frames that waited for the first segments have poses in the end.
  poses_of(system);
  EXPECT_EQ(system.reports()[0].status, FrameStatus::kStarted);
}

TEST(LateSegments, LabelsFollowTheSceneAndTheVan) {
  const VanAhead street;
  constexpr int kFrames = 30, kLag = 5;
  System system(kitti_camera(), with(1, kLag), Schedule::kSequential);
  std::vector<bool> on_van;
  int fixed = 0, fixed_right = 0, van = 0, van_right = 0;
  std::vector<std::int32_t> names;
  system.set_observer([&](const FrameObservation& seen) {
    if (seen.report->index < 2 * kLag) return;
    ASSERT_EQ(seen.priors.size(), on_van.size());
    for (std::size_t k = 0; k < on_van.size(); ++k) {
      const std::uint16_t label = seen.priors[k].label;
      (on_van[k] ? van : fixed) += 1;
      if (on_van[k] && label == VanAhead::car()) {
        ++van_right;
        names.push_back(seen.priors[k].instance);
      }
      fixed_right += !on_van[k] && label == VanAhead::building() ? 1 : 0;
    }
  });
  for (int i = 0; i < kFrames; ++i) {
    system.add_segments(i, street.segments(i, 100 + i));  // names do not persist
    system.feed(street.look(i, &on_van));
  }
  EXPECT_GE(fixed_right, 0.95 * fixed) << fixed_right << " of " << fixed;
  EXPECT_GE(van_right, 0.90 * van) << van_right << " of " << van;
  ASSERT_FALSE(names.empty());
  EXPECT_EQ(std::ranges::count(names, names.front()), std::ssize(names)) << "one identity";
}

TEST(LateSegments, TheVanIsBelievedToMove) {
  const VanAhead street;
  System system(kitti_camera(), with(5, 3), Schedule::kSequential);
  double p_moving = -1;
  system.set_observer([&](const FrameObservation& seen) {
    p_moving = -1;
    for (const ObservedInstance& i : seen.instances) {
      if (i.label == VanAhead::car()) p_moving = i.p_moving;
    }
  });
  for (int i = 0; i < 25; ++i) {
    if (i % 5 == 0) system.add_segments(i, street.segments(i));
    system.feed(street.look(i));
    if (i >= 13) {
      EXPECT_GT(p_moving, 0.5) << "frame " << i;
    }
  }
}

TEST(LateSegments, SpeedOfTheNetworkDoesNotMatter) {
  const VanAhead street;
  constexpr int kFrames = 16;
  for (const Schedule schedule : {Schedule::kSequential, Schedule::kPipelined}) {
    const auto run = [&](int pause_ms) {
      System system(kitti_camera(), with(3, 2), schedule);
      std::thread network([&] {
        for (int i = 0; i < kFrames; i += 3) {
          std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
          system.add_segments(i, street.segments(i));
        }
      });
      for (int i = 0; i < kFrames; ++i) system.feed(street.look(i));
      network.join();
      system.finish();
      return poses_of(system);
    };
    const std::vector<Rigid3> alone = run(0);
    EXPECT_TRUE(same(alone, run(30)));
    // The same while other threads take the processors.
    std::atomic<bool> busy = true;
    std::vector<std::thread> load;
    for (unsigned k = 0; k < 2 * std::max(1U, std::thread::hardware_concurrency()); ++k) {
      load.emplace_back([&] {
        while (busy.load(std::memory_order_relaxed)) {
        }
      });
    }
    const std::vector<Rigid3> loaded = run(2);
    busy = false;
    for (std::thread& thread : load) thread.join();
    EXPECT_TRUE(same(alone, loaded));
  }
}

TEST(LateSegments, AFailureHasTheSameEffectWheneverItComes) {
  const VanAhead street;
  constexpr int kFrames = 10;
  // What a network gives before it fails: nothing, or the segments of frame 0.
  for (const int given : {0, 1}) {
    const auto run = [&](int pause_ms) {
      System system(kitti_camera(), with(1, 4), Schedule::kSequential);
      if (given == 1) system.add_segments(0, street.segments(0));
      std::thread network([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
        system.end_segments();
      });
      if (pause_ms == 0) network.join();
      for (int i = 0; i < kFrames; ++i) system.feed(street.look(i));
      if (pause_ms > 0) network.join();
      system.finish();
      return poses_of(system);
    };
    EXPECT_TRUE(same(run(0), run(100))) << given;
  }
}

TEST(LateSegments, AnImageWithoutSegmentsSaysNothing) {
  const VanAhead street;
  System system(kitti_camera(), with(2, 1), Schedule::kSequential);
  std::ptrdiff_t labelled = 0;
  system.set_observer([&](const FrameObservation& seen) {
    labelled += std::ranges::count_if(
        seen.priors, [](const kys::Prior& prior) { return prior.label != kys::kVoidLabel; });
  });
  for (int i = 0; i < 8; ++i) {
    auto nothing = std::make_shared<SegmentImage>();
    nothing->map = ImageOf<std::uint16_t>(kitti_camera().width, kitti_camera().height, 0);
    if (i % 2 == 0) system.add_segments(i, nothing);
    EXPECT_EQ(system.feed(street.look(i)).warning, "") << i;
  }
  system.finish();
  poses_of(system);
  EXPECT_EQ(labelled, 0);
}

TEST(LateSegments, OnesOlderThanTheMemoryAreNotCarried) {
  const VanAhead street;
  const auto coverage = [&](const char* memory) {  // of the frames from the lag on
    Settings settings = with(1, 8);
    settings.set("control.segment_memory", memory);
    System system(kitti_camera(), settings, Schedule::kSequential);
    double most = 0;
    for (int i = 0; i < 14; ++i) {
      system.add_segments(i, street.segments(i));
      const FrameReport report = system.feed(street.look(i));
      if (i > 8) most = std::max(most, report.prior_coverage);
    }
    system.finish();
    poses_of(system);
    return most;
  };
  EXPECT_GT(coverage("3"), 0.5);
  EXPECT_EQ(coverage("0.5"), 0);  // 8 frames are 0.8 s
}

TEST(LateSegments, KeyframesAndLandmarksMadeBeforeGetTheirPriors) {
  const VanAhead street;
  Settings settings = with(100, 3);
  settings.set("kys.mode", "kys");  // a mode without beliefs, in which a map needs no segments
  System system(kitti_camera(), settings, Schedule::kSequential);
  for (int i = 0; i < 3; ++i) system.feed(street.look(i));
  const auto labelled = [&] {
    const MapSnapshot map = system.snapshot();
    const auto count = std::ranges::count_if(map.landmarks, [](const MapSnapshot::Landmark& l) {
      return l.label == VanAhead::building() || l.label == VanAhead::car();
    });
    return static_cast<double>(count) / static_cast<double>(map.landmarks.size());
  };
  EXPECT_EQ(labelled(), 0);
  system.add_segments(0, street.segments(0));
  for (int i = 3; i < 12; ++i) system.feed(street.look(i));
  system.finish();
  // What has not been in view at frame 0 has no segment.
  EXPECT_GT(labelled(), 0.8);
}

TEST(LateSegments, AWaitEndsWithOneWarning) {
  const VanAhead street;
  System system(kitti_camera(), with(1, 2, 0.05), Schedule::kSequential);
  system.add_segments(0, street.segments(0));
  int warnings = 0;
  for (int i = 0; i < 10; ++i) {
    const std::string& warning = system.feed(street.look(i)).warning;
    warnings += warning.find("segments of frame 1") != std::string::npos ? 1 : 0;
  }
  system.finish();
  EXPECT_EQ(warnings, 1);
  poses_of(system);
}

TEST(LateSegments, ANetworkThatEndsIsNotWaitedFor) {
  const VanAhead street;
  System system(kitti_camera(), with(1, 2), Schedule::kPipelined);
  system.end_segments();
  for (int i = 0; i < 6; ++i) system.feed(street.look(i));
  system.finish();
  poses_of(system);
}

TEST(LateSegments, FramesThatWaitedAreTrackedWhenTheRunEnds) {
  const VanAhead street;
  System system(kitti_camera(), with(1, 5), Schedule::kSequential);
  for (int i = 0; i < 4; ++i) system.feed(street.look(i));
  system.finish();
  EXPECT_EQ(poses_of(system).size(), 4u);
}

TEST(LateSegments, RealtimeTakesThemWhenTheyAreThere) {
  const VanAhead street;
  System system(kitti_camera(), with(1, 0), Schedule::kRealtime);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(system.feed(street.look(i)).segments_of, -1);
  system.add_segments(2, street.segments(2));
  EXPECT_EQ(system.feed(street.look(4)).segments_of, 2);
  system.add_segments(4, street.segments(4));
  for (int i = 5; i < 8; ++i) system.feed(street.look(i));
  EXPECT_EQ(system.reports()[5].segments_of, 4);
  EXPECT_EQ(system.reports()[6].segments_of, -1);
  EXPECT_EQ(system.reports()[1].status, FrameStatus::kLost) << "before the first segments";
  EXPECT_EQ(system.reports()[3].status, FrameStatus::kTracked);
}

TEST(LateSegments, WhatIsWrongIsSaidToTheCaller) {
  const VanAhead street;
  System system(kitti_camera(), with(1, 2), Schedule::kSequential);
  const auto message = [&](std::int64_t frame, std::shared_ptr<SegmentImage> image) {
    try {
      system.add_segments(frame, std::move(image));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  auto small = street.segments(0);
  small->map = ImageOf<std::uint16_t>(10, 10, 0);
  EXPECT_NE(message(0, small).find("10x10"), std::string::npos);
  auto label = street.segments(0);
  label->segments[1].label = 133;
  EXPECT_NE(message(0, label).find("label 133"), std::string::npos);
  auto missing = street.segments(0);
  missing->segments.pop_back();
  EXPECT_NE(message(0, missing).find("segment 2"), std::string::npos);
  EXPECT_NE(message(-1, nullptr), "");
  EXPECT_EQ(message(0, street.segments(0)), "");
  EXPECT_NE(message(0, street.segments(0)).find("twice"), std::string::npos);
}

}  // namespace
}  // namespace kys_slam
