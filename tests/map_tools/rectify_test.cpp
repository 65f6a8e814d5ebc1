// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/rig_rows.h>
#include <kys_slam/sequence.h>

#include "io/temporary_folder.h"
#include "support/run_command.h"
#include "support/small_sequence.h"

// rectify_sequence --calibration: images of the pair without the error.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;

class RectifyCorrected : public ::testing::Test {
 protected:
  RectifyCorrected() { testing::write_small_sequence(sequence_); }

  /// A file with a correction of the sequence's calibration.
  fs::path correction(const std::string& name, double row, double focal) {
    const StereoCamera camera = open_kitti_sequence(sequence_)->camera();
    RigCorrection::Parameters values = RigCorrection::Parameters::Zero();
    values[static_cast<int>(RigParameter::kRow)] = row;
    values[static_cast<int>(RigParameter::kFocal)] = focal;
    const fs::path file = folder_ / name;
    write_text(file, to_yaml(CorrectionFile{camera, {RigCorrection(camera, values), rig_prior()}}));
    return file;
  }
  int rectify(const fs::path& calibration, const fs::path& output) {
    Command command("rectify_sequence", {sequence_.string(), "--output", output.string(),
                                         "--calibration", calibration.string()});
    const int status = command.wait();
    error_ = command.err();
    return status;
  }

  TemporaryFolder folder_;
  fs::path sequence_ = folder_ / "sequence";
  fs::path output_ = folder_ / "corrected";
  std::string error_;
};

TEST_F(RectifyCorrected, MovesTheRightImageByTheRow) {
  ASSERT_EQ(rectify(correction("r.yaml", 1, 0), output_), 0) << error_;
  const auto before = open_kitti_sequence(sequence_), after = open_kitti_sequence(output_);
  EXPECT_EQ(after->camera(), before->camera());
  EXPECT_EQ(after->frame_count(), before->frame_count());
  for (const std::int64_t t : {std::int64_t{0}, after->frame_count() - 1}) {
    EXPECT_NEAR(after->frame(t).timestamp, before->frame(t).timestamp, 1e-8);
    const StereoFrame given = before->read(t), corrected = after->read(t);
    for (int y = 0; y + 1 < given.left.height(); ++y) {
      for (int x = 0; x < given.left.width(); ++x) {
        ASSERT_EQ(corrected.left.at(x, y), given.left.at(x, y));
        ASSERT_EQ(corrected.right.at(x, y), given.right.at(x, y + 1)) << "it is a row too low";
      }
    }
  }
}

TEST_F(RectifyCorrected, TheBaselineIsThatOfTheTrueRig) {
  ASSERT_EQ(rectify(correction("r.yaml", 0, 0.01), output_), 0) << error_;
  const StereoCamera before = open_kitti_sequence(sequence_)->camera();
  const StereoCamera after = open_kitti_sequence(output_)->camera();
  EXPECT_NEAR(after.baseline, before.baseline / 1.01, 1e-9);
  EXPECT_EQ(after.fx, before.fx);
}

TEST_F(RectifyCorrected, RefusesOtherCalibrations) {
  const fs::path file = correction("r.yaml", 1, 0);
  ASSERT_EQ(rectify(file, output_), 0) << error_;
  EXPECT_EQ(rectify(file, output_), 0) << "goes on";
  EXPECT_EQ(rectify(correction("s.yaml", 2, 0), output_), 2) << "made with another";
  (void)correction("r.yaml", 3, 0);
  EXPECT_EQ(rectify(file, output_), 2) << "another content";
  CorrectionFile other = *read_correction_file(file);
  other.given.fx += 1;
  write_text(file, to_yaml(other));
  EXPECT_EQ(rectify(file, folder_ / "anew"), 2);
  EXPECT_NE(error_.find("another calibration"), std::string::npos) << error_;
  EXPECT_EQ(rectify(folder_ / "none.yaml", folder_ / "anew"), 2);
  EXPECT_FALSE(fs::exists(folder_ / "anew"));
}

}  // namespace
}  // namespace kys_slam
