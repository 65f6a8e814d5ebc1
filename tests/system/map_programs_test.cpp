// SPDX-License-Identifier: BSD-3-Clause
// Loops and saved maps as a user of the programs meets them, on simulated features of a round road.
#include <gtest/gtest.h>
#include <kys_slam/trajectory_file.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "support/feature_world.h"
#include "support/repeatable_content.h"
#include "support/run_command.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::BusyCores;
using testing::Command;
using testing::read_text;
using testing::repeatable_content;

/// Features along one round and 25 m more, made once.
const fs::path& ring_features() {
  static const TemporaryFolder folder;
  static const fs::path file = [] {
    std::vector<Rigid3> poses;
    for (double s = 0; s < testing::ring_length() + 25; s += 0.9) {
      poses.push_back(testing::ring_pose(0).inverse() * testing::ring_pose(s));
    }
    write_kitti_poses(folder / "ring.txt", poses);
    Command simulate("simulate_features", {(folder / "ring.txt").string(), "--output",
                                           (folder / "ring.features").string(), "--features", "800",
                                           "--seed", "2", "--quiet"});
    EXPECT_EQ(simulate.wait(120), 0) << simulate.err();
    return folder / "ring.features";
  }();
  return file;
}

class MapPrograms : public ::testing::Test {
 protected:
  fs::path run(const std::string& name, std::vector<std::string> arguments, int status = 0,
               const std::string& error = "") {
    const fs::path output = work_ / name;
    arguments.insert(arguments.begin(),
                     {ring_features().string(), "--quiet", "--output", output.string()});
    Command command("run_stereo_kitti", arguments);
    EXPECT_EQ(command.wait(300), status) << command.err();
    if (status != 0) {
      EXPECT_EQ(testing::count_lines(command.err()), 1) << command.err();
      EXPECT_NE(command.err().find(error), std::string::npos) << command.err();
    }
    return output;
  }
  static nlohmann::json summary(const fs::path& output) {
    return nlohmann::json::parse(read_text(output / "summary.json"));
  }
  TemporaryFolder work_;
};

class LoopDeterminism : public MapPrograms, public ::testing::WithParamInterface<const char*> {};

TEST_P(LoopDeterminism, LoopsAreClosedTheSameWayUnderLoad) {
  const std::string schedule = GetParam();
  const fs::path first =
      run("idle", {"--schedule", schedule, "--save-map", (work_ / "idle.map").string()});
  EXPECT_GE(summary(first)["loops_closed"], 1);
  EXPECT_EQ(summary(first)["submaps"], 1);
  const auto idle = repeatable_content(first);
  const BusyCores load(3);
  const fs::path second =
      run("busy", {"--schedule", schedule, "--save-map", (work_ / "busy.map").string()});
  const auto busy = repeatable_content(second);
  ASSERT_EQ(busy.size(), idle.size());
  for (const auto& [file, text] : idle) EXPECT_TRUE(busy.at(file) == text) << file << " differs";
  EXPECT_TRUE(read_text(work_ / "idle.map") == read_text(work_ / "busy.map"));
}

INSTANTIATE_TEST_SUITE_P(Schedules, LoopDeterminism, ::testing::Values("sequential", "pipelined"),
                         [](const auto& schedule) { return std::string(schedule.param); });

TEST_F(MapPrograms, AMapIsSavedAndLocalisedIn) {
  const std::string map = (work_ / "ring.map").string();
  run("first", {"--frames", "120", "--save-map", map});
  const std::string before = read_text(map);
  const fs::path again =
      run("again", {"--start", "30", "--frames", "40", "--load-map", map, "--localize-only",
                    "--save-map", (work_ / "same.map").string()});
  EXPECT_EQ(summary(again)["frames_connected"], 40);
  EXPECT_EQ(summary(again)["keyframes_made"], 0);
  EXPECT_TRUE(read_text(work_ / "same.map") == before) << "a frozen map is as it was";
  const fs::path on = run("on", {"--start", "60", "--load-map", map});
  EXPECT_GT(summary(on)["keyframes_made"], 10);
  EXPECT_EQ(summary(on)["frames_connected"], summary(on)["frames"]);
}

TEST_F(MapPrograms, ADamagedMapIsRefusedInOneLine) {
  const fs::path map = work_ / "ring.map";
  run("first", {"--frames", "30", "--save-map", map.string()});
  const std::string good = read_text(map);
  const auto refuse = [&](const std::string& bytes, const std::string& reason) {
    const fs::path bad = work_ / "bad.map";
    std::ofstream(bad, std::ios::binary) << bytes;
    run("refused", {"--load-map", bad.string()}, 2, bad.string() + ": ");
    run("refused", {"--load-map", bad.string()}, 2, reason);
  };
  std::string flipped = good;
  flipped[good.size() / 2] = static_cast<char>(flipped[good.size() / 2] ^ 4);
  refuse(flipped, "");
  refuse(good.substr(0, good.size() / 3), "");
  refuse("", "");
  refuse("P6 1 1 255 not a map at all", "");
  run("refused", {"--load-map", (work_ / "none.map").string()}, 2, "none.map");
  run("refused", {"--localize-only"}, 2, "--localize-only needs --load-map");
}

TEST_F(MapPrograms, AMapThatCannotBeWrittenIsToldBeforeTheFirstFrame) {
  const fs::path output =
      run("out", {"--frames", "20", "--save-map", (work_ / "no" / "such" / "folder.map").string()},
          2, "folder.map");
  EXPECT_FALSE(fs::exists(output / "trajectory.tum"));
}

TEST_F(MapPrograms, CtrlCAfterALoopSavesEverything) {
  const fs::path output = work_ / "cut";
  const fs::path map = work_ / "cut.map";
  Command command("run_stereo_kitti", {ring_features().string(), "--quiet", "--output",
                                       output.string(), "--set", "control.stall_ms=5", "--set",
                                       "full_bundle.min_delay=100000", "--save-map", map.string()});
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  const auto sent = std::chrono::steady_clock::now();
  command.send(SIGINT);
  EXPECT_EQ(command.wait(60), 0) << command.err();
  EXPECT_LT(std::chrono::steady_clock::now() - sent, std::chrono::seconds(10))
      << "a hang; the time itself is a benchmark's matter";
  for (const char* file : {"trajectory.tum", "trajectory.kitti", "keyframes.tum", "frames.csv",
                           "graph.csv", "summary.json", "config.yaml", "map.ply"}) {
    EXPECT_TRUE(fs::exists(output / file)) << file;
  }
  EXPECT_TRUE(fs::exists(map));
}

}  // namespace
}  // namespace kys_slam
