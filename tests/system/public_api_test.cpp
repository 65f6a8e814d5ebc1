// SPDX-License-Identifier: BSD-3-Clause
// What a robot's program does with the system beside feeding frames: views with strides, masks,
// looking on from another thread, calls at the wrong time.
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/logic_error.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <thread>

#include "support/feature_world.h"
#include "support/rendered_corridor.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::kitti_camera;
using testing::RenderedCorridor;
using testing::weaving_pose;

constexpr int kFrames = 40;

FeatureWorld world() {
  FeatureWorld::Options options;
  options.pixel_noise = 0.3;
  options.length = 80;
  options.points = 6000;
  return {kitti_camera(), options};
}

void expect_same(const std::vector<FrameEstimate>& a, const std::vector<FrameEstimate>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].connected, b[i].connected);
    EXPECT_EQ(a[i].T_w_c.translation, b[i].T_w_c.translation) << "frame " << i;
    EXPECT_EQ(a[i].T_w_c.rotation.coeffs(), b[i].T_w_c.rotation.coeffs()) << "frame " << i;
  }
}

/// Calls everything that may be called at any time from any thread until it is told to stop. The
/// build with ThreadSanitizer (preset tsan) finds what is not guarded.
class Watcher {
 public:
  explicit Watcher(const System& system) : thread_([this, &system] { watch(system); }) {}
  ~Watcher() { stop(); }

  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  [[nodiscard]] int looks() const { return looks_; }

 private:
  void watch(const System& system) {
    while (!stop_) {
      const MapSnapshot snapshot = system.snapshot();
      const std::vector<FrameEstimate> trajectory = system.trajectory();
      EXPECT_GE(static_cast<std::int64_t>(trajectory.size()), snapshot.frames);
      for (const auto& edge : snapshot.edges) EXPECT_GT(edge.keyframe, edge.other);
      EXPECT_GE(system.keyframes().size(), snapshot.keyframes.empty() ? 0u : 1u);
      for (const Eigen::Vector3d& p_w : system.landmarks()) EXPECT_TRUE(p_w.allFinite());
      EXPECT_LE(system.submaps(), 1u);
      EXPECT_TRUE(system.objects().empty());
      EXPECT_GE(static_cast<std::int64_t>(system.reports().size()), snapshot.frames);
      ++looks_;
    }
  }

  std::atomic<bool> stop_{false};
  std::atomic<int> looks_{0};
  std::thread thread_;
};

std::vector<FrameEstimate> run_watched(Schedule schedule, bool watched) {
  const FeatureWorld w = world();
  System system(w.camera(), Settings(), schedule);
  std::optional<Watcher> watchers[2];
  if (watched) {
    for (auto& watcher : watchers) watcher.emplace(system);
  }
  for (int i = 0; i < kFrames; ++i) system.feed(w.look(i, weaving_pose(0.8 * i)));
  system.finish();  // they go on meanwhile
  if (watched) {
    for (auto& watcher : watchers) {
      while (watcher->looks() == 0) std::this_thread::yield();
      watcher->stop();
    }
  }
  return system.trajectory();
}

TEST(PublicApi, LookingOnFromOtherThreadsChangesNothing) {
  for (const Schedule schedule : {Schedule::kSequential, Schedule::kPipelined}) {
    SCOPED_TRACE(to_string(schedule));
    expect_same(run_watched(schedule, false), run_watched(schedule, true));
  }
}

TEST(PublicApi, LookingOnInRealTime) {
  const std::vector<FrameEstimate> watched = run_watched(Schedule::kRealtime, true);
  ASSERT_EQ(watched.size(), static_cast<std::size_t>(kFrames));
  for (const FrameEstimate& frame : watched) EXPECT_TRUE(frame.connected) << frame.index;
}

TEST(PublicApi, AnotherThreadMayInterrupt) {
  const FeatureWorld w = world();
  System system(w.camera(), Settings(), Schedule::kPipelined);
  std::thread other;
  for (int i = 0; i < kFrames; ++i) {
    system.feed(w.look(i, weaving_pose(0.8 * i)));
    if (i == kFrames / 2) other = std::thread([&] { system.interrupt(); });
  }
  system.finish();
  other.join();
  EXPECT_EQ(system.trajectory().size(), static_cast<std::size_t>(kFrames));
}

TEST(PublicApi, TheSnapshotIsTheMap) {
  const FeatureWorld w = world();
  System system(w.camera(), Settings(), Schedule::kSequential);
  for (int i = 0; i < kFrames; ++i) system.feed(w.look(i, weaving_pose(0.8 * i)));
  system.finish();
  const MapSnapshot snapshot = system.snapshot();
  EXPECT_EQ(snapshot.frames, kFrames);
  const auto keyframes = system.keyframes();
  ASSERT_EQ(snapshot.keyframes.size(), keyframes.size());
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    EXPECT_EQ(snapshot.keyframes[i].timestamp, keyframes[i].timestamp);
    EXPECT_EQ(snapshot.keyframes[i].T_w_c.translation, keyframes[i].T_w_c.translation);
    EXPECT_EQ(snapshot.keyframes[i].submap, snapshot.main_submap);
  }
  EXPECT_EQ(snapshot.landmarks.size(), system.landmarks().size());
  // A spanning tree has one edge less than keyframes.
  const auto in_tree = [](const MapSnapshot::Edge& e) { return e.spanning_tree; };
  EXPECT_EQ(std::count_if(snapshot.edges.begin(), snapshot.edges.end(), in_tree),
            static_cast<std::ptrdiff_t>(keyframes.size()) - 1);
}

TEST(PublicApi, TheObserverSeesEveryFrameAndMayAskForTheMap) {
  const FeatureWorld w = world();
  System system(w.camera(), Settings(), Schedule::kPipelined);
  int frames = 0;
  system.set_observer([&](const FrameObservation& seen) {
    EXPECT_EQ(seen.report->index, frames++);
    EXPECT_EQ(seen.keypoints.size(), static_cast<std::size_t>(seen.report->keypoints));
    EXPECT_EQ(seen.depths.size(), seen.keypoints.size());
    EXPECT_EQ(seen.landmarks.size(), seen.keypoints.size());
    const auto tracked = std::count_if(seen.landmarks.begin(), seen.landmarks.end(),
                                       [](std::int64_t id) { return id >= 0; });
    EXPECT_GE(tracked, seen.report->inliers);
    EXPECT_EQ(system.snapshot().frames, frames);
  });
  for (int i = 0; i < 10; ++i) system.feed(w.look(i, weaving_pose(0.8 * i)));
  EXPECT_EQ(frames, 10);
}

TEST(PublicApi, AFrameAfterFinishIsRefused) {
  const FeatureWorld w = world();
  System system(w.camera(), Settings(), Schedule::kPipelined);
  system.feed(w.look(0, weaving_pose(0)));
  EXPECT_THROW(system.load_map("any.map"), LogicError);
  system.finish();
  system.finish();  // no harm
  EXPECT_THROW(system.feed(w.look(1, weaving_pose(0.8))), LogicError);
  EXPECT_EQ(system.trajectory().size(), 1u);
}

TEST(PublicApi, ViewsOfAnyStrideAreTheSamePixels) {
  const StereoCamera camera{320, 240, 250, 250, 159.5, 119.5, 0.4};
  const RenderedCorridor corridor(camera, 3);
  std::vector<FrameEstimate> results[2];
  for (const bool strided : {false, true}) {
    System system(camera, Settings::indoor(), Schedule::kSequential);
    for (int i = 0; i < 6; ++i) {
      const StereoFrame frame =
          corridor.look(i, Rigid3(Eigen::Quaterniond::Identity(), {0, 0, 0.2 * i}));
      if (!strided) {
        system.feed(frame);
        continue;
      }
      // Colour, upside down, with gaps between pixels and rows.
      constexpr std::ptrdiff_t kPixel = 5, kRow = 320 * kPixel + 13;
      std::vector<std::uint8_t> memory[2];
      ImageView views[2];
      for (const int side : {0, 1}) {
        const GrayImage& image = side == 0 ? frame.left : frame.right;
        memory[side].assign(240 * kRow, 0x5A);
        for (int y = 0; y < 240; ++y) {
          for (int x = 0; x < 320; ++x) {
            for (int c = 0; c < 3; ++c) {
              memory[side][(239 - y) * kRow + x * kPixel + c] = image.at(x, y);
            }
          }
        }
        views[side] = {
            memory[side].data() + 239 * kRow, 320, 240, PixelFormat::kBgr8, -kRow, kPixel};
      }
      system.feed(frame.timestamp, views[0], views[1]);
    }
    system.finish();
    results[strided ? 1 : 0] = system.trajectory();
  }
  EXPECT_TRUE(results[0].back().connected);
  expect_same(results[0], results[1]);
}

TEST(PublicApi, MaskedKeypointsAreDropped) {
  const StereoCamera camera{320, 240, 250, 250, 159.5, 119.5, 0.4};
  const RenderedCorridor corridor(camera, 3);
  const StereoFrame frame = corridor.look(0, Rigid3());
  StereoMasks masks;
  masks.left = GrayImage(320, 240, 0);
  for (int y = 0; y < 240; ++y) std::fill_n(masks.left.row(y), 160, std::uint8_t{7});
  System system(camera, Settings::indoor(), Schedule::kSequential);
  int seen = 0;
  system.set_observer([&](const FrameObservation& o) {
    for (const Keypoint& k : o.keypoints) EXPECT_GE(k.x, 159.5F);
    seen = static_cast<int>(o.keypoints.size());
  });
  const FrameReport report = system.feed(frame, masks);
  EXPECT_GT(report.masked, 50);
  EXPECT_GT(seen, 50);
  masks.right = GrayImage(319, 240, 0);
  EXPECT_THROW(system.feed(corridor.look(1, Rigid3()), masks), InputError);
}

}  // namespace
}  // namespace kys_slam
