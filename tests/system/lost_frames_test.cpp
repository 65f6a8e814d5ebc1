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
using testing::small_camera;
using testing::small_sequence;

/// Columns "status" and "reason" of every row of frames.csv.
std::vector<std::pair<std::string, std::string>> outcomes(const fs::path& output) {
  std::vector<std::pair<std::string, std::string>> rows;
  std::istringstream lines(read_text(output / "frames.csv"));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::istringstream cells(line);
    std::string cell;
    for (int i = 0; i < 3; ++i) std::getline(cells, cell, ',');
    std::pair<std::string, std::string> row;
    std::getline(cells, row.first, ',');
    std::getline(cells, cell, '"');
    std::getline(cells, row.second, '"');
    rows.push_back(row);
  }
  return rows;
}

class LostFrames : public ::testing::Test {
 protected:
  LostFrames() { copy_small_sequence(work_ / "seq"); }
  /// Both images of these frames become one shade of grey.
  void paint(int first, int last, std::uint8_t shade) {
    for (int i = first; i <= last; ++i) {
      const GrayImage image(small_camera().width, small_camera().height, shade);
      write_png(work_ / "seq" / "image_0" / image_name(i), image);
      write_png(work_ / "seq" / "image_1" / image_name(i), image);
    }
  }
  /// The images of one camera become one shade of grey.
  void shut(const char* camera, int first, int last, std::uint8_t shade = 0) {
    for (int i = first; i <= last; ++i) {
      write_png(work_ / "seq" / camera / image_name(i),
                GrayImage(small_camera().width, small_camera().height, shade));
    }
  }
  std::vector<std::string> warnings() {
    return nlohmann::json::parse(read_text(work_ / "out" / "summary.json"))["warnings"];
  }
  int run(std::string* err = nullptr) {
    Command command("run_stereo_kitti",
                    {(work_ / "seq").string(), "--quiet", "--output", (work_ / "out").string()});
    const int status = command.wait();
    if (err != nullptr) *err = command.err();
    return status;
  }
  TemporaryFolder work_;
};

TEST_F(LostFrames, ASequenceAllOfOneShadeFailsWithoutACrash) {
  for (const int shade : {0, 255, 128}) {
    paint(0, kSmallFrames - 1, static_cast<std::uint8_t>(shade));
    std::filesystem::remove_all(work_ / "out");  // results of another recording
    std::string err;
    EXPECT_EQ(run(&err), 3) << "shade " << shade;
    EXPECT_EQ(err, "run_stereo_kitti: tracking failed: 0 of 12 frames tracked\n");
    const auto rows = outcomes(work_ / "out");
    ASSERT_EQ(rows.size(), static_cast<std::size_t>(kSmallFrames));
    for (const auto& [status, reason] : rows) {
      EXPECT_EQ(status, "lost");
      EXPECT_EQ(reason, "the image has no corners");
    }
    EXPECT_EQ(read_text(work_ / "out" / "trajectory.tum"), "");
    EXPECT_EQ(count_lines(read_text(work_ / "out" / "trajectory.kitti")), kSmallFrames);
  }
}

TEST_F(LostFrames, DarkFramesInTheMiddleAreLostAndTheRestIsTracked) {
  paint(5, 6, 0);
  EXPECT_EQ(run(), 0);
  const auto rows = outcomes(work_ / "out");
  ASSERT_EQ(rows.size(), static_cast<std::size_t>(kSmallFrames));
  EXPECT_EQ(rows[0].first, "started");
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const bool dark = i == 5 || i == 6;
    EXPECT_EQ(rows[i].first, dark ? "lost" : "tracked") << "frame " << i << ": " << rows[i].second;
    if (dark) {
      EXPECT_EQ(rows[i].second, "the image has no corners");
    }
  }
  EXPECT_EQ(count_lines(read_text(work_ / "out" / "trajectory.tum")), kSmallFrames - 2);
  EXPECT_EQ(count_lines(read_text(work_ / "out" / "trajectory.kitti")), kSmallFrames);
}

TEST_F(LostFrames, ACameraThatWakesUpLateStartsLate) {
  paint(0, 2, 255);
  EXPECT_EQ(run(), 0);
  const auto rows = outcomes(work_ / "out");
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(rows.at(i).first, "lost");
  EXPECT_EQ(rows.at(3).first, "started");
  EXPECT_EQ(rows.at(4).first, "tracked");
}

TEST_F(LostFrames, ADeadLeftCameraIsALossAndToldOnce) {
  shut("image_0", 6, 7);
  std::string err;
  EXPECT_EQ(run(&err), 0);
  const std::string dead = "the left image shows nothing, the other one does";
  EXPECT_NE(err.find("frame 6: " + dead), std::string::npos) << err;
  EXPECT_EQ(err.find("frame 7: "), std::string::npos) << err;
  const auto rows = outcomes(work_ / "out");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool shut = i == 6 || i == 7;
    EXPECT_EQ(rows[i].first == "lost", shut) << i;
    EXPECT_EQ(rows[i].second.find(dead) != std::string::npos, shut) << i << rows[i].second;
  }
  EXPECT_EQ(warnings(), std::vector{dead + " (2 of 12 frames, the first is 6)"});
}

TEST_F(LostFrames, ADeadRightCameraIsToldAndTheMapCarriesOn) {
  for (const int shade : {0, 128}) {
    shut("image_1", 6, 7, static_cast<std::uint8_t>(shade));
    std::string err;
    EXPECT_EQ(run(&err), 0);
    const std::string dead = "the right image shows nothing, the other one does";
    EXPECT_NE(err.find("frame 6: " + dead), std::string::npos) << err;
    const auto rows = outcomes(work_ / "out");
    for (std::size_t i = 1; i < rows.size(); ++i) {
      EXPECT_EQ(rows[i].first, "tracked") << i << rows[i].second;
      const bool told = rows[i].second.find(dead) != std::string::npos;
      EXPECT_EQ(told, i == 6 || i == 7) << i << rows[i].second;
    }
    EXPECT_EQ(warnings(), std::vector{dead + " (2 of 12 frames, the first is 6)"});
  }
}

TEST_F(LostFrames, HalfAnImageAndAFrozenOneAreTold) {
  GrayImage half = read_gray(work_ / "seq" / "image_1" / image_name(4));
  for (int y = half.height() / 2; y < half.height(); ++y) {
    for (int x = 0; x < half.width(); ++x) half.at(x, y) = 0;
  }
  write_png(work_ / "seq" / "image_1" / image_name(4), half);
  fs::copy_file(work_ / "seq" / "image_1" / image_name(8),
                work_ / "seq" / "image_1" / image_name(9), fs::copy_options::overwrite_existing);
  EXPECT_EQ(run(), 0);
  EXPECT_EQ(warnings(),
            (std::vector<std::string>{
                "the lower half of the right image shows nothing, the other image does (1 of 12 "
                "frames, the first is 4)",
                "the right image is that of the frame before, the other one is new (1 of 12 "
                "frames, the first is 9)"}));
}

TEST_F(LostFrames, NothingIsToldOfASoundPair) {
  std::string err;
  EXPECT_EQ(run(&err), 0);
  EXPECT_EQ(err, "");
  EXPECT_EQ(warnings(), std::vector<std::string>());
}

TEST(Pace, AStallComesOnTopOfEveryFrame) {
  const TemporaryFolder work;
  Command command("run_stereo_kitti",
                  {small_sequence().string(), "--output", (work / "out").string(), "--schedule",
                   "realtime", "--set", "control.stall_ms=50", "--quiet"});
  ASSERT_EQ(command.wait(60), 0) << command.err();
  const auto summary = nlohmann::json::parse(read_text(work / "out" / "summary.json"));
  // Frames 0.1 s apart leave room for a stall of 0.05 s, which may not vanish in it. A sleep never
  // is too short, so this holds on any machine.
  const double least = (kSmallFrames - 1) * 0.1 + kSmallFrames * 0.05;
  EXPECT_GE(summary["process"]["wall_s"].get<double>(), least - 0.001);
}

TEST(Interrupt, CtrlCSavesEverythingAndExitsWithinTwoSeconds) {
  for (const char* schedule : {"pipelined", "sequential", "realtime"}) {
    const TemporaryFolder work;
    const fs::path output = work / "out";
    // Half a second per frame: there is a middle to be interrupted in.
    Command command("run_stereo_kitti",
                    {small_sequence().string(), "--output", output.string(), "--schedule", schedule,
                     "--set", "control.stall_ms=500", "--quiet"});
    for (int i = 0; i < 2000 && !fs::exists(output); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    const auto begin = std::chrono::steady_clock::now();
    command.send(SIGINT);
    EXPECT_EQ(command.wait(20), 0) << command.err();
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    EXPECT_LT(taken.count(), 2.0) << schedule;
    const int rows = count_lines(read_text(output / "trajectory.tum"));
    EXPECT_GE(rows, 1) << schedule;
    EXPECT_LT(rows, kSmallFrames) << schedule;
    const auto summary = nlohmann::json::parse(read_text(output / "summary.json"));
    EXPECT_EQ(summary["complete"], false);
    EXPECT_EQ(summary["end_reason"], "interrupted");
    EXPECT_EQ(summary["frames"], rows);
    for (const char* file :
         {"trajectory.kitti", "keyframes.tum", "frames.csv", "config.yaml", "map.ply"}) {
      EXPECT_TRUE(fs::exists(output / file)) << file;
    }
    for (const auto& entry : fs::directory_iterator(output)) {
      EXPECT_EQ(entry.path().string().find(".tmp"), std::string::npos)
          << "a temporary file is left";
    }
  }
}

}  // namespace
}  // namespace kys_slam
