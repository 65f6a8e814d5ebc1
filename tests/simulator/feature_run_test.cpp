// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "io/temporary_folder.h"
#include "simulator/common/coco_classes.h"
#include "simulator/features/feature_world.h"
#include "simulator/perception/perception.h"
#include "support/run_command.h"

// The run_stereo programs on files of simulate_features instead of sequence folders.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::count_lines;
using testing::read_text;

constexpr int kFrames = 30;

/// A drive along a gentle curve, 0.6 m per frame.
simulator::FeaturePath curve() {
  simulator::FeaturePath path;
  path.camera = {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.53716};
  path.ground = 1.65;
  for (int i = 0; i < kFrames; ++i) {
    const double a = 0.01 * i;
    const Rigid3 T(Eigen::Quaterniond(Eigen::AngleAxisd(a, Eigen::Vector3d::UnitY())),
                   Eigen::Vector3d(60 * (1 - std::cos(a)), 0, 60 * std::sin(a)));
    path.poses.push_back({100 + 0.1 * i, T});
  }
  return path;
}

class FeatureRun : public ::testing::Test {
 protected:
  FeatureRun() {
    simulator::FeatureOptions options;
    options.features = 800;
    const simulator::FeatureWorld world(curve(), options);
    FeatureSequenceWriter writer(file_, world.info());
    for (std::size_t i = 0; i < kFrames; ++i) writer.write(world.frame(i));
    writer.finish();
  }
  nlohmann::json run(const std::string& program, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments{file_.string(), "--output", output_.string(), "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Command command(program, arguments);
    EXPECT_EQ(command.wait(), 0) << command.err();
    return nlohmann::json::parse(read_text(output_ / "summary.json"));
  }
  void expect_refused(const fs::path& input, const std::vector<std::string>& parts,
                      std::vector<std::string> more = {}) {
    for (const std::string program : {"run_stereo_kitti", "run_stereo_euroc"}) {
      std::vector<std::string> arguments{input.string(), "--output", output_.string(), "--quiet"};
      arguments.insert(arguments.end(), more.begin(), more.end());
      Command command(program, arguments);
      EXPECT_EQ(command.wait(), 2);
      EXPECT_EQ(count_lines(command.err()), 1) << command.err();
      EXPECT_EQ(command.err().rfind(program + ": ", 0), 0U) << command.err();
      for (const std::string& part : parts) {
        EXPECT_NE(command.err().find(part), std::string::npos) << part << ": " << command.err();
      }
    }
  }
  TemporaryFolder work_;
  fs::path file_ = work_ / "curve.dat";  // known by what is in it, not by its name
  fs::path output_ = work_ / "out";
};

TEST_F(FeatureRun, BothProgramsTrackIt) {
  for (const char* program : {"run_stereo_kitti", "run_stereo_euroc"}) {
    const auto summary = run(program);
    EXPECT_EQ(summary["sequence"], "curve");
    EXPECT_EQ(summary["frames"], kFrames);
    EXPECT_EQ(summary["frames_tracked"], kFrames);
    EXPECT_LT(summary["ate_se3_rmse_m"], 0.15) << "over 18 m";
    EXPECT_NEAR(summary["path_length_m"], 0.6 * (kFrames - 1), 0.5);
    EXPECT_EQ(count_lines(read_text(output_ / "trajectory.tum")), kFrames);
    EXPECT_EQ(count_lines(read_text(output_ / "ground_truth.tum")), kFrames);
    EXPECT_EQ(read_text(output_ / "trajectory.tum").substr(0, 6), "100.00");
  }
}

TEST_F(FeatureRun, SameFilesWhateverTheRun) {
  run("run_stereo_kitti", {"--schedule", "pipelined"});
  const std::string first = read_text(output_ / "trajectory.tum");
  run("run_stereo_kitti", {"--schedule", "pipelined"});
  EXPECT_EQ(first, read_text(output_ / "trajectory.tum"));
}

TEST_F(FeatureRun, PriorsInTheFileCountAsPriors) {
  run("run_stereo_kitti", {"--mode", "stock"});
  const std::string without = read_text(output_ / "trajectory.tum");
  simulator::FeatureOptions options;
  options.features = 800;
  options.labelled = true;
  const simulator::FeatureWorld world(curve(), options);
  FeatureFileInfo info = world.info();
  info.label_space = simulator::kFeatureLabelSpace;
  FeatureSequenceWriter writer(file_, info, world.truth());
  simulator::Perception detector(world, simulator::perception_level("exact"), 1);
  for (std::size_t i = 0; i < kFrames; ++i) {
    FeatureFrame frame = world.frame(i);
    detector.add_priors(i, frame);
    writer.write(frame);
  }
  writer.finish();
  const auto summary = run("run_stereo_kitti", {"--overwrite"});
  EXPECT_EQ(summary["mode"], "verified");
  EXPECT_EQ(summary["frames_tracked"], kFrames);
  run("run_stereo_kitti",
      {"--overwrite", "--set",
       "control.label_space=" + std::string(KYS_SOURCE_DIR) + "/kys/data/coco_panoptic_133"});
  run("run_stereo_kitti", {"--set", "kys.normalize=false", "--overwrite"});
  EXPECT_NE(read_text(output_ / "trajectory.tum"), without) << "priors change nothing";
  run("run_stereo_kitti", {"--mode", "stock", "--overwrite"});
  EXPECT_EQ(read_text(output_ / "trajectory.tum"), without) << "the features are the same";
  expect_refused(file_, {"curve.dat", "coco_panoptic_133", "ade20k_150"},
                 {"--set", "control.label_space=ade20k_150"});
}

TEST_F(FeatureRun, PartOfTheFile) {
  const auto summary = run("run_stereo_kitti", {"--start", "5", "--frames", "12"});
  EXPECT_EQ(summary["frames"], 12);
  EXPECT_EQ(count_lines(read_text(output_ / "ground_truth.tum")), 12);
  const std::string frames = read_text(output_ / "frames.csv");
  EXPECT_NE(frames.find("\n5,000005,100.5"), std::string::npos) << frames.substr(0, 900);
  expect_refused(file_, {"curve.dat", "30 frames"}, {"--start", "30"});
}

TEST_F(FeatureRun, AnythingElseIsRefusedInOneLine) {
  write_text(work_ / "text.features", "hello");
  expect_refused(work_ / "text.features", {"text.features", "neither", "feature file"});
  write_text(work_ / "empty", "");
  expect_refused(work_ / "empty", {"empty", "neither"});
  write_text(work_ / "short", read_text(file_).substr(0, 60));
  expect_refused(work_ / "short", {"short", "truncated"});
  std::string damaged = read_text(file_);
  damaged[40] ^= 1;
  write_text(work_ / "damaged", damaged);
  expect_refused(work_ / "damaged", {"damaged", "checksum"});
  expect_refused(work_ / "nowhere", {"nowhere"});
  expect_refused("/dev/null", {"/dev/null"});
  expect_refused(file_, {"curve.dat", "orb.levels", "8 octaves at 1.2"}, {"--set", "orb.levels=6"});
}

TEST_F(FeatureRun, DamageInTheMiddleKeepsWhatWasTracked) {
  std::string damaged = read_text(file_);
  damaged[damaged.size() * 2 / 3] ^= 1;
  write_text(work_ / "damaged", damaged);
  expect_refused(work_ / "damaged", {"damaged", "frame", "checksum"});
  const auto summary = nlohmann::json::parse(read_text(output_ / "summary.json"));
  EXPECT_EQ(summary["complete"], false);
  EXPECT_GT(summary["frames"], kFrames / 2);
  EXPECT_LT(summary["frames"], kFrames);
  EXPECT_EQ(count_lines(read_text(output_ / "trajectory.kitti")), summary["frames"]);
}

}  // namespace
}  // namespace kys_slam
