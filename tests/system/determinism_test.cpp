// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>

#include "support/repeatable_content.h"
#include "support/run_command.h"
#include "support/small_sequence.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::BusyCores;
using testing::Command;
using testing::kSmallFrames;
using testing::repeatable_content;
using testing::small_sequence;

class Determinism : public ::testing::Test {
 protected:
  std::map<std::string, std::string> run(const std::string& schedule, const std::string& name) {
    const fs::path output = work_ / name;
    Command command(
        "run_stereo_kitti",
        {small_sequence().string(), "--schedule", schedule, "--quiet", "--output", output.string(),
         // Keyframes at every chance: the back end has to have something to do.
         "--set", "keyframes.reference_ratio=0.97", "--set", "keyframes.starved_ratio=0.97",
         "--set", "calibration.keyframes=4"});
    EXPECT_EQ(command.wait(120), 0) << command.err();
    return repeatable_content(output);
  }
  void expect_repeatable(const std::string& schedule) {
    const auto idle = run(schedule, "idle");
    for (const char* file :
         {"trajectory.tum", "trajectory.kitti", "keyframes.tum", "frames.csv", "covariance.csv",
          "graph.csv", "summary.json", "config.yaml", "map.ply", "ground_truth.tum"}) {
      EXPECT_TRUE(idle.count(file) == 1) << file;
    }
    const auto summary = nlohmann::json::parse(idle.at("summary.json"));
    EXPECT_EQ(summary["frames_tracked"], kSmallFrames);
    EXPECT_GE(summary["keyframes_made"], 4) << "too few to say anything of the back end";
    const BusyCores load(3);
    for (const char* again : {"busy", "busy_again"}) {
      const auto other = run(schedule, again);
      ASSERT_EQ(other.size(), idle.size());
      for (const auto& [file, text] : idle) {
        EXPECT_TRUE(other.at(file) == text) << schedule << ": " << file << " differs";
      }
    }
  }
  TemporaryFolder work_;
};

TEST_F(Determinism, SequentialRunsAreIdenticalUnderLoad) {
  expect_repeatable("sequential");
}

TEST_F(Determinism, PipelinedRunsAreIdenticalUnderLoad) {
  expect_repeatable("pipelined");
}

TEST_F(Determinism, TheRunIsAccurate) {
  const auto files = run("pipelined", "out");
  const auto summary = nlohmann::json::parse(files.at("summary.json"));
  EXPECT_LT(summary["ate_se3_rmse_m"], 0.05) << "over 5.5 m, images of 400x122 px";
  EXPECT_NEAR(summary["path_length_m"], 5.5, 0.1);
}

}  // namespace
}  // namespace kys_slam
