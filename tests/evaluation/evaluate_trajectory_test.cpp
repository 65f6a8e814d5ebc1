// SPDX-License-Identifier: BSD-3-Clause
// Runs the program itself: its output, and its status and message for bad input.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>

#include "temporary_folder.h"

namespace kys_slam {
namespace {

struct Finished {
  int status = -1;
  std::string output;  // of stdout and stderr
};

Finished evaluate_trajectory(const std::string& arguments) {
  const std::string command =
      std::string(KYS_BIN_DIR) + "/evaluate_trajectory " + arguments + " 2>&1";
  Finished run;
  std::FILE* pipe = ::popen(command.c_str(), "r");
  char buffer[4096];
  while (std::size_t n = std::fread(buffer, 1, sizeof buffer, pipe)) run.output.append(buffer, n);
  const int status = ::pclose(pipe);
  run.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return run;
}

const std::string kData = std::string(KYS_SOURCE_DIR) + "/tests/evaluation/data/";

TEST(EvaluateTrajectory, PrintsATableOrJson) {
  const std::string files =
      "--reference " + kData + "reference.tum --estimate " + kData + "estimate.tum";
  const Finished table = evaluate_trajectory(files + " --align sim3");
  EXPECT_EQ(table.status, 0) << table.output;
  EXPECT_NE(table.output.find("126 associated"), std::string::npos) << table.output;
  EXPECT_NE(table.output.find("0.085311"), std::string::npos) << table.output;
  const Finished json = evaluate_trajectory(files + " --json --rpe 5");
  EXPECT_EQ(json.status, 0);
  EXPECT_NE(json.output.find("\"rmse\": 0.8136146864"), std::string::npos) << json.output;
  EXPECT_NE(json.output.find("\"rpe_delta_frames\": 5"), std::string::npos);
  EXPECT_EQ(evaluate_trajectory("--help").status, 0);
}

TEST(EvaluateTrajectory, AStepThatNoPairHasGivesNoFigures) {
  const std::string files =
      "--reference " + kData + "reference.tum --estimate " + kData + "estimate.tum --rpe 1000";
  const Finished table = evaluate_trajectory(files);
  EXPECT_EQ(table.status, 0) << table.output;
  EXPECT_EQ(table.output.find("0.000000"), std::string::npos) << table.output;
  EXPECT_NE(table.output.find("E_R [deg] per 1000 frames             -"), std::string::npos)
      << table.output;
  const Finished json = evaluate_trajectory(files + " --json");
  EXPECT_EQ(json.status, 0);
  EXPECT_NE(json.output.find("\"rmse\": null"), std::string::npos) << json.output;
}

TEST(EvaluateTrajectory, BadInputIsOneLineAndStatusTwo) {
  const TemporaryFolder folder;
  write_text(folder / "bad.tum", "1 0 0 0 0 0 0 1\n2 0 0 nan 0 0 0 1\n");
  write_text(folder / "kitti.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  write_text(folder / "late.tum", "900 0 0 0 0 0 0 1\n901 0 0 0 0 0 0 1\n");
  write_text(folder / "empty.tum", "# nothing\n");
  write_text(folder / "five.tum", "1 2 3 4 5\n");
  const std::string reference = "--reference " + kData + "reference.tum --estimate ";
  const auto expect_refused = [](const std::string& arguments, const std::string& part) {
    const Finished run = evaluate_trajectory(arguments);
    EXPECT_EQ(run.status, 2) << arguments;
    EXPECT_EQ(std::count(run.output.begin(), run.output.end(), '\n'), 1) << run.output;
    EXPECT_NE(run.output.find(part), std::string::npos) << run.output;
  };
  const auto file = [&](const char* name) { return (folder / name).string(); };
  expect_refused(reference + file("bad.tum"), "bad.tum:2");
  expect_refused(reference + file("kitti.txt"), "no time stamps");
  expect_refused(reference + file("late.tum"), "only 0 poses");
  expect_refused(reference + file("empty.tum"), "no poses");
  expect_refused(reference + file("five.tum"), "5 columns");
  expect_refused(reference + file("none.tum"), "none.tum");
  expect_refused(reference + file("late.tum") + " --align se4", "se4");
  expect_refused(reference + file("late.tum") + " --rpe 0", "--rpe");
  expect_refused("--estimate x", "--reference");
}

TEST(EvaluateTrajectory, MovesTheReferenceFromBodyToCamera) {
  const TemporaryFolder folder;
  // The camera sits 1 m along the body's x and does not turn with respect to it; the body turns.
  write_text(folder / "sensor.yaml",
             "T_BS:\n  data: [1,0,0,1, 0,1,0,0, 0,0,1,0, 0,0,0,1]\nresolution: [60, 40]\n"
             "camera_model: pinhole\nintrinsics: [50, 50, 30, 20]\n"
             "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n");
  write_text(folder / "body.tum", "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1 0\n3 0 0 5 0 0 0 1\n");
  write_text(folder / "camera.tum", "1 1 0 0 0 0 0 1\n2 -1 0 0 0 0 1 0\n3 1 0 5 0 0 0 1\n");
  const std::string files = "--json --align none --reference " + (folder / "body.tum").string() +
                            " --estimate " + (folder / "camera.tum").string();
  const Finished moved =
      evaluate_trajectory(files + " --body-to-camera " + (folder / "sensor.yaml").string());
  EXPECT_EQ(moved.status, 0) << moved.output;
  EXPECT_NE(moved.output.find("\"max\": 0.0"), std::string::npos) << moved.output;
  EXPECT_NE(evaluate_trajectory(files).output.find("\"max\": 1.0"), std::string::npos);
  // EuRoC's order of the quaternion comes with commas, not with nanoseconds.
  const std::string t = "140371527326214";
  write_text(folder / "body.tum", t + "1000 0 0 0 0 0 0 1\n" + t + "4000 0 0 5 0 0 0 1\n");
  write_text(folder / "camera.tum", t + "1000 1 0 0 0 0 0 1\n" + t + "4000 1 0 5 0 0 0 1\n");
  const Finished late =
      evaluate_trajectory(files + " --body-to-camera " + (folder / "sensor.yaml").string());
  EXPECT_EQ(late.status, 0) << late.output;
  EXPECT_EQ(late.output.find("\"max\": 2.0"), std::string::npos) << late.output;
}

}  // namespace
}  // namespace kys_slam
