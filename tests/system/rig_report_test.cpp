// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "support/run_command.h"
#include "support/small_sequence.h"

// What a run says about the calibration: in summary.json and in its table.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::copy_small_sequence;
using testing::image_name;
using testing::kSmallFrames;
using testing::read_text;

class RigReported : public ::testing::Test {
 protected:
  RigReported() { copy_small_sequence(work_ / "seq"); }
  /// Everything in the right images is one row lower.
  void lower_right_images() {
    for (int i = 0; i < kSmallFrames; ++i) {
      const fs::path file = work_ / "seq" / "image_1" / image_name(i);
      const GrayImage image = read_gray(file);
      GrayImage lower = image;
      for (int row = 1; row < image.height(); ++row) {
        std::memcpy(lower.data() + row * image.width(), image.row(row - 1),
                    static_cast<std::size_t>(image.width()));
      }
      write_png(file, lower);
    }
  }
  nlohmann::json run(std::vector<std::string> options = {}) {
    options.insert(options.begin(), {(work_ / "seq").string(), "--schedule", "sequential",
                                     "--output", (work_ / "out").string(), "--overwrite"});
    Command command("run_stereo_kitti", options);
    EXPECT_EQ(command.wait(120), 0) << command.err();
    table_ = command.out();
    return nlohmann::json::parse(read_text(work_ / "out" / "summary.json"))["rig"];
  }
  TemporaryFolder work_;
  std::string table_;
};

TEST_F(RigReported, AGoodPairNeedsNoCorrection) {
  const nlohmann::json rig = run();
  EXPECT_LT(rig["rows_field_px"], 0.1);
  EXPECT_LT(rig["rows_sigma_before_px"], 0.3);
  EXPECT_EQ(rig["corrected"], "none");
  EXPECT_EQ(rig["offset_px"], 0);
  EXPECT_TRUE(rig["offset_sigma_px"].is_null()) << "nothing was estimated";
  EXPECT_TRUE(rig["parameters"].empty());
  EXPECT_TRUE(rig["offset_estimate"].is_null());
  EXPECT_EQ(table_.find("calibration"), std::string::npos) << table_;
}

// What is estimated and too small to be applied is said, and what is applied says so.
TEST_F(RigReported, AnOffsetThatIsNotAppliedIsSaid) {
  const std::vector<std::string> often{
      "--set", "keyframes.reference_ratio=0.97", "--set", "keyframes.starved_ratio=0.97",
      "--set", "calibration.keyframes=4",        "--set", "calibration.significance=1000"};
  const nlohmann::json rig = run(often);
  EXPECT_EQ(rig["corrected"], "none");
  EXPECT_EQ(rig["offset_px"], 0);
  EXPECT_TRUE(rig["parameters"].empty());
  const nlohmann::json& found = rig["offset_estimate"];
  ASSERT_TRUE(found.is_object());
  EXPECT_EQ(found["applied"], false);
  EXPECT_GE(found["sigma_px"], 0.026 * 0.7) << "with the systematic part";
  EXPECT_LT(std::abs(found["value_px"].get<double>()), 0.2);
  EXPECT_NE(table_.find(" px found, not applied"), std::string::npos) << table_;
  const std::string trajectory = read_text(work_ / "out" / "trajectory.tum");
  auto off = often;
  off.insert(off.end(), {"--set", "calibration.enabled=false"});
  run(off);
  EXPECT_EQ(read_text(work_ / "out" / "trajectory.tum"), trajectory) << "nothing was applied";
}

TEST_F(RigReported, RowsThatDifferAreNamedWithTheirCorrection) {
  lower_right_images();
  const nlohmann::json rig = run();
  EXPECT_NEAR(rig["rows_field_px"], 1, 0.1);
  EXPECT_LT(rig["rows_sigma_after_px"], 0.3 * rig["rows_sigma_before_px"].get<double>());
  EXPECT_EQ(rig["corrected"], "all");
  const nlohmann::json& parameters = rig["parameters"];
  EXPECT_EQ(parameters.size(), 17U);
  EXPECT_EQ(parameters["row"]["unit"], "px");
  EXPECT_NEAR(parameters["row"]["value"], 1, 0.2);
  EXPECT_GT(parameters["row"]["sigma"], 0);
  EXPECT_LT(parameters["row"]["sigma"], 0.2);
  EXPECT_EQ(parameters["offset"]["value"], rig["offset_px"]);
  EXPECT_NE(table_.find("  calibration                  rows differed by "), std::string::npos)
      << table_;
  EXPECT_NE(table_.find(" px (rms); corrected, standard deviation "), std::string::npos) << table_;
}

TEST_F(RigReported, AnOffsetOfDisparitiesHasItsSign) {
  // Keyframes at every chance: the offset has to be looked for.
  const nlohmann::json rig =
      run({"--set", "stereo.added_disparity=0.5", "--set", "keyframes.reference_ratio=0.97",
           "--set", "keyframes.starved_ratio=0.97", "--set", "calibration.keyframes=4"});
  EXPECT_EQ(rig["corrected"], "offset");
  EXPECT_LT(rig["rows_field_px"], 0.1);
  ASSERT_FALSE(rig["offset_sigma_px"].is_null());
  EXPECT_GT(rig["offset_sigma_px"], 0);
  EXPECT_NEAR(rig["offset_px"], -0.5, 3 * rig["offset_sigma_px"].get<double>());
  EXPECT_EQ(rig["parameters"].size(), 1U);
  EXPECT_EQ(rig["parameters"]["offset"]["value"], rig["offset_px"]);
  EXPECT_TRUE(rig["offset_estimate"]["applied"] == true ||
              rig["offset_estimate"]["value_px"] != rig["offset_px"]);
  EXPECT_NE(table_.find("  calibration                  disparity offset -0."), std::string::npos)
      << table_;
}

TEST_F(RigReported, WithoutTheCheckNothingIsSaidOfRows) {
  lower_right_images();
  const nlohmann::json rig = run({"--set", "calibration.rows=false"});
  EXPECT_TRUE(rig["rows_field_px"].is_null());
  EXPECT_TRUE(rig["rows_sigma_before_px"].is_null());
  EXPECT_TRUE(rig["rows_sigma_after_px"].is_null());
  EXPECT_EQ(rig["corrected"], "none");
}

// The threshold decides; what is measured stays to be read.
TEST_F(RigReported, RowsThatDifferByLessThanAskedAreNotCorrected) {
  lower_right_images();
  const nlohmann::json rig = run({"--set", "calibration.min_field=3"});
  EXPECT_NEAR(rig["rows_field_px"], 1, 0.1);
  EXPECT_EQ(rig["corrected"], "none");
  EXPECT_NE(table_.find("px (rms); not corrected"), std::string::npos) << table_;
}

}  // namespace
}  // namespace kys_slam
