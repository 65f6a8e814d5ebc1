// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/calibration_hash.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>
#include <kys_slam/util/atomic_file.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>

#include "support/run_command.h"
#include "support/small_sequence.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::count_lines;
using testing::kSmallFrames;
using testing::read_text;
using testing::small_camera;
using testing::small_sequence;

constexpr int kSpoilt = 7;  ///< the frame whose prior file is spoilt

std::string prior_name(int i) {
  return fmt::format("{:06d}.kysp", i);
}

/// Priors of the corridor, near enough: the floor below, a wall above, nothing moves.
FramePriors corridor_priors(const StereoCamera& camera) {
  FramePriors priors;
  priors.label_space = "coco_panoptic_133";
  priors.calibration_hash = calibration_hash(camera);
  for (const std::int32_t first : {0, prior_format::kRightInstances}) {
    CameraPriors side;
    side.segments = {{.label = 100, .instance = first}, {.label = 130, .instance = first + 1}};
    side.segment_map = ImageOf<std::uint16_t>(camera.width, camera.height, 1);
    std::fill(side.segment_map.row(camera.height / 2),
              side.segment_map.data() + side.segment_map.size(), std::uint16_t{2});
    priors.cameras.push_back(std::move(side));
  }
  return priors;
}

void write_priors(const fs::path& file, const StereoCamera& camera) {
  write_file_atomic(
      file, std::span<const std::uint8_t>(encode_priors(corridor_priors(camera), file.string())));
}

class PriorFilesInARun : public ::testing::Test {
 protected:
  PriorFilesInARun() {
    fs::create_directories(priors_);
    for (int i = 0; i < kSmallFrames; ++i) write_priors(priors_ / prior_name(i), small_camera());
  }

  /// Runs the program with the priors; its status.
  int run(const std::string& output, std::vector<std::string> more = {}) {
    std::vector<std::string> arguments{small_sequence().string(), "--priors",
                                       priors_.string(),          "--output",
                                       (work_ / output).string(), "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Command command("run_stereo_kitti", arguments);
    const int status = command.wait();
    err_ = command.err();
    return status;
  }
  std::string saved(const std::string& output, const std::string& file) {
    return read_text(work_ / output / file);
  }
  nlohmann::json summary(const std::string& output) {
    return nlohmann::json::parse(saved(output, "summary.json"));
  }

  /// The run has to end at the spoilt frame with status 2 and one line that names the file and says
  /// `what`; all it saved has to be what a run of the frames before it gives.
  void expect_stopped(const std::string& what) {
    for (const std::string schedule : {"sequential", "pipelined"}) {
      SCOPED_TRACE(schedule);
      ASSERT_EQ(run("short", {"--schedule", schedule, "--frames", std::to_string(kSpoilt)}), 0)
          << err_;
      EXPECT_EQ(run("stopped", {"--schedule", schedule}), 2);
      EXPECT_EQ(count_lines(err_), 1) << err_;
      EXPECT_EQ(err_.rfind("run_stereo_kitti: ", 0), 0u) << err_;
      EXPECT_NE(err_.find(prior_name(kSpoilt) + ": "), std::string::npos) << err_;
      EXPECT_NE(err_.find(what), std::string::npos) << "'" << what << "' is not in: " << err_;
      EXPECT_EQ(count_lines(saved("stopped", "trajectory.tum")), kSpoilt);
      for (const char* file : {"trajectory.tum", "trajectory.kitti", "keyframes.tum", "map.ply"}) {
        EXPECT_EQ(saved("stopped", file), saved("short", file)) << file;
      }
      EXPECT_EQ(count_lines(saved("stopped", "frames.csv")), kSpoilt + 1);
      const auto json = summary("stopped");
      EXPECT_EQ(json["complete"], false);
      EXPECT_EQ(json["frames"], kSpoilt);
      EXPECT_NE(err_.find(json["end_reason"].get<std::string>()), std::string::npos);
    }
  }

  fs::path spoilt() { return priors_ / prior_name(kSpoilt); }

  TemporaryFolder work_;
  fs::path priors_ = work_ / "priors";
  std::string err_;
};

TEST_F(PriorFilesInARun, AllAreThere) {
  EXPECT_EQ(run("out"), 0) << err_;
  EXPECT_EQ(err_, "");
  EXPECT_EQ(summary("out")["mode"], "verified");
  EXPECT_EQ(summary("out")["missing_priors"], 0);
  EXPECT_EQ(summary("out")["frames_tracked"], kSmallFrames);
}

TEST_F(PriorFilesInARun, OneIsTruncated) {
  fs::resize_file(spoilt(), fs::file_size(spoilt()) - 9);
  expect_stopped("truncated");
}

TEST_F(PriorFilesInARun, OneIsEmpty) {
  fs::resize_file(spoilt(), 0);
  expect_stopped("not a prior file");
}

TEST_F(PriorFilesInARun, OneHasAFlippedByte) {
  std::string bytes = read_text(spoilt());
  bytes[bytes.size() - 5] = static_cast<char>(~bytes[bytes.size() - 5]);
  write_text(spoilt(), bytes);
  expect_stopped("checksum");
}

TEST_F(PriorFilesInARun, OneIsOfAnotherCalibration) {
  StereoCamera other = small_camera();
  other.baseline += 0.001;
  write_priors(spoilt(), other);
  expect_stopped("another calibration");
}

TEST_F(PriorFilesInARun, OneIsOfAnotherImageSize) {
  StereoCamera other = small_camera();
  other.width /= 2;
  write_priors(spoilt(), other);
  expect_stopped("200x122, the sequence has 400x122");
}

TEST_F(PriorFilesInARun, OneIsAFolder) {
  fs::remove(spoilt());
  fs::create_directory(spoilt());
  expect_stopped("not a regular file");
}

TEST_F(PriorFilesInARun, TwoAreMissing) {
  fs::remove(priors_ / prior_name(3));
  fs::remove(spoilt());
  EXPECT_EQ(run("out"), 0) << err_;
  EXPECT_EQ(count_lines(err_), 1) << "warned once: " << err_;
  EXPECT_NE(err_.find(prior_name(3)), std::string::npos) << err_;
  EXPECT_EQ(summary("out")["missing_priors"], 2);
  EXPECT_EQ(summary("out")["complete"], true);
  EXPECT_EQ(summary("out")["frames_tracked"], kSmallFrames);
}

TEST_F(PriorFilesInARun, OneIsMissingAndMustNotBe) {
  fs::remove(spoilt());
  EXPECT_EQ(run("out", {"--strict-priors"}), 2);
  EXPECT_EQ(count_lines(err_), 1) << err_;
  EXPECT_NE(err_.find(prior_name(kSpoilt)), std::string::npos) << err_;
  EXPECT_EQ(count_lines(saved("out", "trajectory.tum")), kSpoilt);
  EXPECT_EQ(summary("out")["complete"], false);
}

TEST_F(PriorFilesInARun, OfAnotherLabelSpaceThanConfigured) {
  EXPECT_EQ(run("out", {"--set", "control.label_space=vkitti2"}), 2);
  EXPECT_EQ(count_lines(err_), 1) << err_;
  EXPECT_NE(err_.find("coco_panoptic_133, configured is vkitti2"), std::string::npos) << err_;
}

}  // namespace
}  // namespace kys_slam
