// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/rig_rows.h>

#include <fstream>
#include <string>
#include <vector>

#include "temporary_folder.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;

const StereoCamera kCamera{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};

CorrectionFile sample_correction() {
  RigCorrection::Parameters values;
  values << 0.011, -0.004, 0.001, -0.002, 0.009, -0.003, -0.001, -0.006, 0.02, 0.004, 0.002, 0.001,
      0.6, -0.4, 0.003, -0.006, -0.008;
  return {kCamera, {RigCorrection(kCamera, values), 0.1 * rig_prior()}};
}

class RigFile : public ::testing::Test {
 protected:
  fs::path write(const std::string& text) {
    std::ofstream(file_) << text;
    return file_;
  }
  /// The message when it is refused.
  std::string refused(const std::string& text) {
    write(text);
    try {
      (void)read_rig_correction(file_, kCamera);
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(file_.string()), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    ADD_FAILURE() << "accepted: " << text;
    return "";
  }
  /// The sample with a part replaced.
  static std::string with(const std::string& part, const std::string& other) {
    std::string text = to_yaml(sample_correction());
    const std::size_t at = text.find(part);
    EXPECT_NE(at, std::string::npos) << part;
    return text.replace(at, part.size(), other);
  }

  TemporaryFolder folder_;
  fs::path file_ = folder_.path() / "refined.yaml";
};

TEST_F(RigFile, GivesBackWhatWasWritten) {
  const CorrectionFile before = sample_correction();
  write(to_yaml(rig_of(kCamera, "test")) + to_yaml(before));
  const auto after = read_correction_file(file_);
  ASSERT_TRUE(after);
  EXPECT_EQ(after->given, kCamera);
  EXPECT_EQ(after->estimate.correction.parameters(), before.estimate.correction.parameters());
  EXPECT_EQ(after->estimate.covariance, before.estimate.covariance);
  EXPECT_EQ(read_rig_correction(file_, kCamera).covariance, before.estimate.covariance);
  // The same file is the calibration itself.
  const auto camera = read_stereo_rig(std::vector<fs::path>{file_}).rectified();
  ASSERT_TRUE(camera);
  EXPECT_EQ(*camera, kCamera);
}

TEST_F(RigFile, ACorrectionIsForItsOwnCalibration) {
  write(to_yaml(sample_correction()));
  for (const int what : {0, 1, 2, 3, 4}) {
    StereoCamera other = kCamera;
    if (what == 0) other.fx *= 1.001;
    if (what == 1) other.cx += 0.1;
    if (what == 2) other.baseline *= 1.01;
    if (what == 3) other.width -= 1;
    if (what == 4) other.height += 1;
    EXPECT_THROW((void)read_rig_correction(file_, other), InputError) << what;
  }
  StereoCamera rounded = kCamera;
  rounded.fx *= 1 + 1e-12;
  EXPECT_NO_THROW((void)read_rig_correction(file_, rounded));
}

TEST_F(RigFile, WithoutACorrectionThereIsNone) {
  write(to_yaml(rig_of(kCamera, "test")));
  EXPECT_FALSE(read_correction_file(file_));
  EXPECT_NE(refused(to_yaml(rig_of(kCamera, "test"))).find("no correction"), std::string::npos);
  // A calibration by another program is no plain tree.
  write("%YAML:1.0\n---\nM1: !!opencv-matrix\n  rows: 3\n");
  EXPECT_FALSE(read_correction_file(file_));
  EXPECT_THROW((void)read_correction_file(folder_.path() / "none.yaml"), InputError);
}

TEST_F(RigFile, RefusesWhatCannotBe) {
  refused("correction: 3\n");
  refused("correction: [1, 2]\n");
  refused("correction:\n");
  refused("correction: {given: {}, parameters: {}, covariance: []}\n");
  refused("correction: {given: &a {b: *a}}\n");
  refused("- correction\n");
  for (const char* value : {".nan", ".inf", "1e999", "x", "[1]", "{}", "~", ""}) {
    refused(with("left_k1: 0.011", std::string("left_k1: ") + value));
    refused(with("fx: 718.856", std::string("fx: ") + value));
  }
  refused(with("    left_k1: 0.011\n", ""));
  refused(with("left_k1: 0.011", "left_k9: 0.011"));
  refused(with("    left_k1: 0.011\n", "    left_k1: 0.011\n    left_k9: 0\n"));
  refused(with("width: 1241", "width: 1241.5"));
  refused(with("width: 1241", "width: -1241"));
  refused(with("width: 1241", "width: 1e9"));
  refused(with("baseline: 0.5371657", "baseline: -1"));
  refused(with("fy: 718.856", "fy: 0"));
}

TEST_F(RigFile, RefusesCorrectionsThatAreNotSmall) {
  EXPECT_NE(refused(with("offset: 0.6", "offset: 500")).find("tenth"), std::string::npos);
  refused(with("left_k1: 0.011", "left_k1: 3"));
  refused(with("left_k1: 0.011", "left_k1: 1e300"));
  refused(with("focal: -0.008", "focal: -1"));
  refused(with("baseline_z: -0.006", "baseline_z: 0.9"));
}

TEST_F(RigFile, RefusesWhatIsNoCovariance) {
  std::string text = to_yaml(sample_correction());
  const std::size_t begin = text.find('[');
  const auto covariance = [&](const std::vector<double>& values) {
    std::string list = "[";
    for (const double value : values) list += (list.size() > 1 ? ", " : "") + std::to_string(value);
    return text.substr(0, begin) + list + "]\n";
  };
  std::vector<double> identity;
  for (int r = 0; r < RigCorrection::kSize; ++r) {
    for (int c = 0; c <= r; ++c) identity.push_back(r == c ? 1 : 0);
  }
  write(covariance(identity));
  EXPECT_NO_THROW((void)read_rig_correction(file_, kCamera));
  auto changed = identity;
  changed[0] = -1;
  refused(covariance(changed));
  changed = identity;
  changed[1] = 2;  // a correlation of 2
  refused(covariance(changed));
  changed = identity;
  changed[0] = 0;
  changed[1] = 0.5;  // of something without variance
  refused(covariance(changed));
  changed = identity;
  changed.pop_back();
  refused(covariance(changed));
}

}  // namespace
}  // namespace kys_slam
