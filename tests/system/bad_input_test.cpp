// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "support/run_command.h"
#include "support/small_sequence.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::copy_small_sequence;
using testing::count_lines;
using testing::image_name;
using testing::kSmallFrames;
using testing::read_text;
using testing::small_sequence;

/// Runs a program that has to refuse its input: status 2, one line on stderr that begins with the
/// program's name and contains `parts`.
void expect_refusal(const std::string& program, const std::vector<std::string>& arguments,
                    const std::vector<std::string>& parts) {
  Command command(program, arguments);
  EXPECT_EQ(command.wait(), 2);
  const std::string err = command.err();
  EXPECT_EQ(count_lines(err), 1) << err;
  EXPECT_EQ(err.rfind(program + ": ", 0), 0u) << err;
  for (const std::string& part : parts) {
    EXPECT_NE(err.find(part), std::string::npos) << "'" << part << "' is not in: " << err;
  }
}

class BadInput : public ::testing::Test {
 protected:
  /// A copy of the sequence to spoil.
  fs::path sequence() {
    const fs::path folder = work_ / "seq";
    if (!fs::exists(folder)) copy_small_sequence(folder);
    return folder;
  }
  fs::path output() { return work_ / "out"; }
  void expect_refused(const std::vector<std::string>& parts, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments{sequence().string(), "--output", output().string(),
                                       "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    expect_refusal("run_stereo_kitti", arguments, parts);
  }
  /// Bad input in the middle: what came before is saved.
  void expect_saved(int frames) {
    EXPECT_EQ(count_lines(read_text(output() / "trajectory.tum")), frames);
    EXPECT_EQ(count_lines(read_text(output() / "trajectory.kitti")), frames);
    EXPECT_EQ(count_lines(read_text(output() / "frames.csv")), frames + 1);
    const auto summary = nlohmann::json::parse(read_text(output() / "summary.json"));
    EXPECT_EQ(summary["complete"], false);
    EXPECT_EQ(summary["frames"], frames);
    EXPECT_NE(summary["end_reason"], "");
    for (const char* file : {"keyframes.tum", "config.yaml", "map.ply"}) {
      EXPECT_TRUE(fs::exists(output() / file)) << file;
    }
  }

  TemporaryFolder work_;
};

TEST_F(BadInput, WhatIsGivenInPlaceOfASequenceIsNamed) {
  const auto says = [&](const fs::path& path, const std::string& part) {
    expect_refusal("run_stereo_kitti", {path.string(), "--output", output().string(), "--quiet"},
                   {path.string(), part});
  };
  for (const char* name : {"left.mp4", "drive.bag"}) {
    write_text(work_ / name, "not looked at");
    says(work_ / name, "kys-slam run");
  }
  fs::create_directories(work_ / "priors");
  write_text(work_ / "priors" / "000000.kysp", "");
  says(work_ / "priors", "--priors");
  says(work_ / "priors" / "000000.kysp", "--priors");
  fs::create_directories(work_ / "run");
  write_text(work_ / "run" / "summary.json", "{}");
  write_text(work_ / "run" / "trajectory.tum", "");
  says(work_ / "run", "evaluate_trajectory");
  fs::create_directories(work_ / "flight" / "mav0" / "cam0" / "data");
  says(work_ / "flight" / "mav0" / "cam0", "run_stereo_euroc");
}

TEST_F(BadInput, ADamagedSequenceIsNotTakenForSomethingElse) {
  write_text(sequence() / "calib.txt", "P0: 1 2 3\n");
  write_text(sequence() / "000000.kysp", "");
  expect_refused({"calib.txt"});
  fs::remove(sequence() / "000000.kysp");
  write_text(sequence() / "summary.json", "{}");
  write_text(sequence() / "trajectory.tum", "");
  expect_refused({"calib.txt"});
  const fs::path mav0 = work_ / "flight" / "mav0";
  for (const char* camera : {"cam0", "cam1"}) {
    fs::create_directories(mav0 / camera / "data");
    write_text(mav0 / camera / "data.csv", "not a row\n");
  }
  expect_refusal("run_stereo_euroc", {mav0.string(), "--output", output().string()},
                 {"data.csv:1"});
  Command command("run_stereo_euroc", {mav0.string(), "--output", output().string()});
  command.wait();
  EXPECT_EQ(command.err().find("to run_stereo_euroc"), std::string::npos) << command.err();
}

TEST_F(BadInput, CalibrationIsMissing) {
  fs::remove(sequence() / "calib.txt");
  expect_refused({"calib.txt"});
}

TEST_F(BadInput, CalibrationIsAFolder) {
  fs::remove(sequence() / "calib.txt");
  fs::create_directory(sequence() / "calib.txt");
  expect_refused({"calib.txt"});
}

TEST_F(BadInput, CalibrationIsNotFinite) {
  write_text(sequence() / "calib.txt",
             "P0: nan 0 199.5 0 0 232 60.5 0 0 0 1 0\nP1: 232 0 199.5 -124 0 232 60.5 0 0 0 1 0\n");
  expect_refused({"calib.txt"});
  write_text(sequence() / "calib.txt",
             "P0: 232 0 199.5 0 0 232 60.5 0 0 0 1 0\nP1: 232 0 199.5 -inf 0 232 60.5 0 0 0 1 0\n");
  expect_refused({"calib.txt"});
}

TEST_F(BadInput, CalibrationHasNoBaseline) {
  const std::string row = " 232 0 199.5 0 0 232 60.5 0 0 0 1 0\n";
  write_text(sequence() / "calib.txt", "P0:" + row + "P1:" + row);
  expect_refused({"calib.txt"});
}

TEST_F(BadInput, CalibrationIsCutOff) {
  write_text(sequence() / "calib.txt", "P0: 232 0 199.5 0 0 232 60.5 0 0 0 1 0\nP1: 232 0 19");
  expect_refused({"calib.txt"});
}

TEST_F(BadInput, TheRightCameraHasFewerImages) {
  for (int i = 0; i < 7; ++i) fs::remove(sequence() / "image_1" / image_name(i));
  expect_refused({"image_1", "5 images", "image_0 has 12", "only 5"});
}

TEST_F(BadInput, ThereIsNoRightCamera) {
  fs::remove_all(sequence() / "image_1");
  expect_refused({"image_1"});
}

TEST_F(BadInput, ThereAreNoImages) {
  for (const char* side : {"image_0", "image_1"}) {
    fs::remove_all(sequence() / side);
    fs::create_directory(sequence() / side);
  }
  expect_refused({"image_0"});
}

TEST_F(BadInput, TheRightImageIsOfAnotherSize) {
  write_png(sequence() / "image_1" / image_name(0), GrayImage(398, 122, 90));
  expect_refused({"image_1/" + image_name(0), "398x122", "400x122"});
}

TEST_F(BadInput, TheSizeChangesInTheMiddle) {
  write_png(sequence() / "image_0" / image_name(6), GrayImage(400, 100, 90));
  expect_refused({"image_0/" + image_name(6), "400x100"});
  expect_saved(6);
}

TEST_F(BadInput, AnImageInTheMiddleIsTruncated) {
  const fs::path image = sequence() / "image_1" / image_name(8);
  fs::resize_file(image, fs::file_size(image) / 2);
  for (const char* schedule : {"pipelined", "sequential"}) {
    expect_refused({"image_1/" + image_name(8)}, {"--schedule", schedule});
    expect_saved(8);
  }
}

TEST_F(BadInput, TheFirstImageIsTruncated) {
  const fs::path image = sequence() / "image_0" / image_name(0);
  fs::resize_file(image, 20);
  expect_refused({"image_0/" + image_name(0)});
}

TEST_F(BadInput, TimeStampsDoNotIncrease) {
  std::string times;
  for (int i = 0; i < kSmallFrames; ++i) times += std::to_string(i == 5 ? 0.4 : 0.1 * i) + "\n";
  write_text(sequence() / "times.txt", times);
  expect_refused({"times.txt", "time stamps do not increase"});
}

TEST_F(BadInput, TimeStampsAreMissingTooFewOrNoNumbers) {
  write_text(sequence() / "times.txt", "0\n0.1\n");
  expect_refused({"times.txt"});
  write_text(sequence() / "times.txt", "0\n0.1\nlater\n");
  expect_refused({"times.txt"});
  fs::remove(sequence() / "times.txt");
  expect_refused({"times.txt"});
}

TEST_F(BadInput, AnUnknownSettingNamesTheNearest) {
  expect_refused({"orb.featurs", "did you mean 'orb.features'?"}, {"--set", "orb.featurs=500"});
  const fs::path config = work_ / "my.yaml";
  write_text(config, "tracking:\n  motion_radus: 9\n");
  expect_refused({"my.yaml", "tracking.motion_radus", "did you mean 'tracking.motion_radius'?"},
                 {"--config", config.string()});
  EXPECT_FALSE(fs::exists(output())) << "nothing is written before the settings are understood";
}

TEST_F(BadInput, SettingsWithValuesThatMakeNoSense) {
  expect_refused({"orb.features"}, {"--set", "orb.features=many"});
  expect_refused({"orb.features"}, {"--set", "orb.features=-5"});
  expect_refused({"stereo.max_distance"}, {"--set", "stereo.max_distance=nan"});
  expect_refused({"KEY=VALUE"}, {"--set", "orb.features"});
  const fs::path config = work_ / "my.yaml";
  expect_refused({"my.yaml"}, {"--config", config.string()});
  write_text(config, "orb: [1, 2\n");
  expect_refused({"my.yaml"}, {"--config", config.string()});
}

TEST_F(BadInput, TheOutputCannotBeWritten) {
  // A file where the folder should be; permissions would not stop a test that runs as root.
  write_text(work_ / "file", "in the way");
  const std::string blocked = (work_ / "file").string() + "/out";
  expect_refusal("run_stereo_kitti", {sequence().string(), "--output", blocked, "--quiet"},
                 {blocked});
  expect_refusal("run_stereo_kitti",
                 {sequence().string(), "--output", (work_ / "file").string(), "--quiet"},
                 {(work_ / "file").string()});
  expect_refusal("run_stereo_kitti", {sequence().string(), "--output", "/proc/out", "--quiet"},
                 {"/proc/out"});
}

TEST_F(BadInput, UnknownOptionsModesAndSchedules) {
  expect_refused({"--bogus"}, {"--bogus"});
  expect_refused({"turbo", "pipelined"}, {"--schedule", "turbo"});
  expect_refused({"magic", "stock"}, {"--mode", "magic"});
  expect_refused({"mode kys needs priors", "--priors"}, {"--mode", "kys"});
  expect_refused({"mode mask needs priors", "--priors"}, {"--set", "kys.mode=mask"});
  EXPECT_FALSE(fs::exists(output()));
  expect_refused({"--frames"}, {"--frames", "some"});
  expect_refused({"--start"}, {"--start", "-3"});
  expect_refused({"--mode"}, {"--mode"});
  expect_refused({"chatty"}, {"--log-level", "chatty"});
}

TEST_F(BadInput, NothingIsLeftOfTheSequence) {
  expect_refused({"seq"}, {"--start", "12"});
}

TEST_F(BadInput, PriorsAreMissing) {
  expect_refused({"nowhere"}, {"--priors", (work_ / "nowhere").string()});
}

TEST_F(BadInput, TheSequenceIsMissingOrNone) {
  for (const char* program : {"run_stereo_kitti", "run_stereo_euroc"}) {
    expect_refusal(program, {}, {"SEQUENCE"});
    expect_refusal(program, {(work_ / "nowhere").string()}, {"nowhere"});
    fs::create_directories(work_ / "empty");
    expect_refusal(program, {(work_ / "empty").string()}, {"empty"});
    write_text(work_ / "file", "text");
    expect_refusal(program, {(work_ / "file").string()}, {"file"});
  }
}

}  // namespace
}  // namespace kys_slam
