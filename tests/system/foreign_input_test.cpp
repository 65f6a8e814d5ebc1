// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/feature_file.h>

#include <nlohmann/json.hpp>

#include "support/run_command.h"
#include "support/small_sequence.h"

// The programs on input as others record it: what is wrong is told in the first frames, what is
// right just runs.
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

class ForeignInput : public ::testing::Test {
 protected:
  ForeignInput() { copy_small_sequence(seq_); }
  int run(std::vector<std::string> more = {}, const std::string& out = "out") {
    std::vector<std::string> arguments{seq_.string(), "--quiet", "--overwrite", "--output",
                                       (work_ / out).string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Command command("run_stereo_kitti", arguments);
    const int status = command.wait();
    err_ = command.err();
    return status;
  }
  nlohmann::json summary() { return nlohmann::json::parse(read_text(work_ / "out/summary.json")); }
  void expect_message(std::initializer_list<std::string> parts) {
    for (const std::string& part : parts) EXPECT_NE(err_.find(part), std::string::npos) << err_;
  }
  template <typename Change>
  void for_each_image(Change&& change) {
    for (const char* camera : {"image_0", "image_1"}) {
      for (int i = 0; i < kSmallFrames; ++i) change(seq_ / camera / image_name(i), i);
    }
  }
  void write_calibration(double fx, double cx, double cy, double baseline) {
    const auto row = [&](const char* name, double x) {
      return fmt::format("{}: {} 0 {} {} 0 {} {} 0 0 0 1 0\n", name, fx, cx, x, fx, cy);
    };
    write_text(seq_ / "calib.txt", row("P0", 0) + row("P1", -fx * baseline));
  }

  const TemporaryFolder work_;
  const fs::path seq_ = work_ / "seq";
  std::string err_;
};

TEST_F(ForeignInput, ABaselineInMillimetresIsRefused) {
  const StereoCamera c = small_camera();
  write_calibration(c.fx, c.cx, c.cy, 1000 * c.baseline);
  EXPECT_EQ(run(), 2);
  expect_message({"calib.txt", "537 m", "537 mm are 0.537 m", "-fx * baseline"});
  EXPECT_EQ(count_lines(err_), 1);
}

TEST_F(ForeignInput, AFeatureFileWithABaselineInMillimetresIsRefused) {
  StereoCamera c = small_camera();
  FeatureFileInfo info;
  info.camera = c;
  info.camera.baseline *= 1000;
  info.scale_factor = 1.2;
  info.levels = 8;
  const fs::path file = work_ / "mm.features";
  info.poses = {{0, Rigid3()}};
  FeatureSequenceWriter writer(file, info);
  writer.write({});
  writer.finish();
  Command command("run_stereo_kitti", {file.string(), "--output", (work_ / "out").string()});
  EXPECT_EQ(command.wait(), 2);
  err_ = command.err();
  expect_message({"mm.features", "537 mm are 0.537 m"});
}

TEST_F(ForeignInput, HalvedImagesWithTheOldIntrinsicsAreTold) {
  const StereoCamera c = small_camera();
  write_calibration(2 * c.fx, 2 * c.cx + 0.5, 2 * c.cy + 0.5, c.baseline);
  run();
  expect_message({"images of about 800x244 px", "400x122", "multiply fx, fy, cx and cy by 0.5"});
  EXPECT_NE(summary()["warnings"].dump().find("800x244"), std::string::npos);
  write_calibration(c.fx, c.cx, c.cy, c.baseline);
  EXPECT_EQ(run(), 0);
  EXPECT_EQ(err_, "");
}

TEST_F(ForeignInput, ImagesOf10And12And14BitsGiveTheSameTrajectory) {
  EXPECT_EQ(run({}, "reference"), 0);
  const std::string reference = read_text(work_ / "reference/trajectory.tum");
  for (const int bits : {10, 12, 14}) {
    for_each_image([&](const fs::path& file, int i) {
      const GrayImage image =
          read_gray(testing::small_sequence() / file.parent_path().filename() / image_name(i));
      Image16 deep(image.width(), image.height());
      for (std::size_t k = 0; k < deep.size(); ++k) {
        deep.data()[k] = static_cast<std::uint16_t>(image.data()[k] << (bits - 8));
      }
      write_png(file, deep);
    });
    EXPECT_EQ(run(), 0) << err_;
    EXPECT_EQ(read_text(work_ / "out/trajectory.tum"), reference) << bits;
    expect_message({fmt::format("of which {} bits are used", bits)});
    EXPECT_EQ(count_lines(err_), 1) << err_;
  }
}

TEST_F(ForeignInput, OneImageForBothCamerasIsRefusedAndOneFrameOfItIsLost) {
  for (int i = 0; i < kSmallFrames; ++i) {
    const auto jpeg = encode_jpeg(read_gray(seq_ / "image_0" / image_name(i)), 85);
    fs::remove(seq_ / "image_1" / image_name(i));
    write_text(seq_ / "image_1" / image_name(i), {jpeg.begin(), jpeg.end()});
  }
  EXPECT_EQ(run(), 2);
  expect_message({"000004", "same image", "two cameras"});
  fs::remove_all(seq_);
  copy_small_sequence(seq_);
  fs::copy_file(seq_ / "image_0" / image_name(6), seq_ / "image_1" / image_name(6),
                fs::copy_options::overwrite_existing);
  EXPECT_EQ(run(), 0);
  expect_message({"frame 6: the left and the right image are the same image"});
  EXPECT_EQ(count_lines(err_), 1);
  EXPECT_EQ(count_lines(read_text(work_ / "out/trajectory.tum")), kSmallFrames - 1);
  EXPECT_LT(summary()["ate_se3_rmse_m"].get<double>(), 0.05);
}

TEST_F(ForeignInput, AMissingImageCostsItsFrameAlone) {
  fs::remove(seq_ / "image_1" / image_name(7));
  fs::remove(seq_ / "image_0" / image_name(9));
  EXPECT_EQ(run(), 0);
  EXPECT_EQ(err_, "");
  EXPECT_EQ(count_lines(read_text(work_ / "out/trajectory.tum")), kSmallFrames - 2);
  EXPECT_EQ(summary()["left_out"]["images without a partner"], 2);
  EXPECT_NEAR(summary()["path_length_m"].get<double>(), 0.5 * (kSmallFrames - 1), 0.1);
  EXPECT_LT(summary()["ate_se3_rmse_m"].get<double>(), 0.05);
}

TEST_F(ForeignInput, OneMaskOfAllFramesAndAnInvertedOne) {
  const StereoCamera c = small_camera();
  GrayImage mask(c.width, c.height, 0);
  for (int y = c.height / 2; y < c.height; ++y) {
    for (int x = 0; x < c.width / 3; ++x) mask.at(x, y) = 255;
  }
  write_png(work_ / "mask.png", mask);
  EXPECT_EQ(run({"--mask", (work_ / "mask.png").string()}), 0);
  EXPECT_EQ(err_, "");
  std::istringstream rows(read_text(work_ / "out/frames.csv"));
  std::string row;
  std::getline(rows, row);
  while (std::getline(rows, row)) {
    std::vector<std::string> cells;
    std::istringstream line(row);
    for (std::string cell; std::getline(line, cell, ',');) cells.push_back(cell);
    EXPECT_GT(std::stoi(cells.at(16)), 0) << row;  // masked
  }
  for (std::size_t i = 0; i < mask.size(); ++i) mask.data()[i] = mask.data()[i] == 0 ? 255 : 0;
  write_png(work_ / "mask.png", mask);
  run({"--mask", (work_ / "mask.png").string()});
  expect_message({"frame 0: a mask covers most of the image", "inverted"});
  write_png(work_ / "mask.png", GrayImage(c.width, c.height, 1));
  EXPECT_EQ(run({"--mask", (work_ / "mask.png").string()}), 3);
  EXPECT_NE(read_text(work_ / "out/frames.csv").find("\"masks leave no corners of the image;"),
            std::string::npos);
  write_png(work_ / "mask.png", GrayImage(c.width, c.height + 1, 0));
  EXPECT_EQ(run({"--mask", (work_ / "mask.png").string()}), 2);
  expect_message({"mask.png", "400x123", "400x122"});
}

TEST_F(ForeignInput, AMapInPiecesSaysSo) {
  const StereoCamera c = small_camera();
  for (int i = 0; i < kSmallFrames; ++i) {  // three places, four frames each
    const testing::RenderedCorridor corridor(c, static_cast<unsigned>(20 + i / 4));
    const StereoFrame frame = corridor.look(i, testing::small_pose(i % 4));
    write_png(seq_ / "image_0" / image_name(i), frame.left);
    write_png(seq_ / "image_1" / image_name(i), frame.right);
  }
  Command command("run_stereo_kitti", {seq_.string(), "--output", (work_ / "out").string(), "--set",
                                       "relocalization.patience=1"});
  EXPECT_EQ(command.wait(), 3);
  err_ = command.err();
  expect_message({"4 of 12 frames connected", "12 are tracked", "3 sub-maps"});
  const std::string table = command.out();
  EXPECT_NE(table.find("frames connected             4 of 12"), std::string::npos) << table;
  EXPECT_NE(table.find("sub-maps                     3"), std::string::npos) << table;
  EXPECT_NE(table.find("submap_*.tum"), std::string::npos) << table;
  int others = 0;
  for (const auto& entry : fs::directory_iterator(work_ / "out")) {
    if (!entry.path().filename().string().starts_with("submap_")) continue;
    ++others;
    EXPECT_EQ(count_lines(read_text(entry.path())), 4) << entry.path();
  }
  EXPECT_EQ(others, 2);
  // A run of one piece leaves no file of the run before.
  fs::remove_all(seq_);
  copy_small_sequence(seq_);
  EXPECT_EQ(run(), 0);
  for (const auto& entry : fs::directory_iterator(work_ / "out")) {
    EXPECT_FALSE(entry.path().filename().string().starts_with("submap_")) << entry.path();
  }
}

TEST_F(ForeignInput, ANearWallWithoutCornersIsNoDeadCamera) {
  // A wall of one shade, so near that it covers the right half of the right image, and less of the
  // left one.
  const StereoCamera c = small_camera();
  const int shift = 60;
  for_each_image([&](const fs::path& file, int i) {
    if (i < 4) return;
    GrayImage image = read_gray(file);
    const bool right = file.parent_path().filename() == "image_1";
    const GrayImage left = read_gray(testing::small_sequence() / "image_0" / image_name(i));
    const int wall = c.width / 2 + (right ? 0 : shift);
    for (int y = 0; y < c.height; ++y) {
      for (int x = 0; x < c.width; ++x) {
        image.at(x, y) = x >= wall ? 20 : right ? left.at(x + shift, y) : left.at(x, y);
      }
    }
    write_png(file, image);
  });
  run();
  EXPECT_EQ(err_.find("shows nothing"), std::string::npos) << err_;
  // Half a camera that is dead is still told.
  for_each_image([&](const fs::path& file, int i) {
    fs::copy_file(testing::small_sequence() / file.parent_path().filename() / image_name(i), file,
                  fs::copy_options::overwrite_existing);
    if (i < 4 || file.parent_path().filename() == "image_0") return;
    GrayImage image = read_gray(file);
    for (int y = 0; y < c.height; ++y)
      std::fill(image.row(y) + c.width / 2, image.row(y) + c.width, 0);
    write_png(file, image);
  });
  run();
  expect_message({"frame 4: the right half of the right image shows nothing"});
}

TEST(ForeignMap, OfAnotherCalibrationSaysWhatToDo) {
  const TemporaryFolder work;
  copy_small_sequence(work / "seq");
  Command first("run_stereo_kitti",
                {(work / "seq").string(), "--quiet", "--output", (work / "out").string(),
                 "--save-map", (work / "a.map").string()});
  ASSERT_EQ(first.wait(), 0);
  std::string calibration = read_text(work / "seq/calib.txt");
  for (std::size_t at = 0; (at = calibration.find("232", at)) != std::string::npos;) {
    calibration.replace(at, 3, "233");
  }
  write_text(work / "seq/calib.txt", calibration);
  Command second("run_stereo_kitti",
                 {(work / "seq").string(), "--quiet", "--output", (work / "out").string(),
                  "--overwrite", "--load-map", (work / "a.map").string()});
  EXPECT_EQ(second.wait(), 2);
  EXPECT_NE(second.err().find("give the calibration that the map was made with"), std::string::npos)
      << second.err();
}

}  // namespace
}  // namespace kys_slam
