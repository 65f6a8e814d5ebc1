#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/rig_rows.h>

#include <cmath>

#include "fitted_rig.h"
#include "io/temporary_folder.h"
#include "prediction.h"
#include "rig_formats.h"
#include "simulated_recordings.h"
#include "support/run_command.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::kKitti;

/// As on KITTI, times `share`.
RigCorrection kitti_correction(double share = 1) {
  RigCorrection::Parameters values;
  values << 0.0155, -0.0110, 0.0008, 0.0016, 0.0112, -0.0047, 0, -0.0068, -0.0274, 0.0023, -0.0002,
      0.0018, 0.22, -0.25, -0.0008, -0.0140, -0.0073;
  return {kKitti, share * values};
}

GrayImage spot_at(const StereoCamera& camera, const Eigen::Vector2d& centre) {
  GrayImage image(camera.width, camera.height);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const double d2 = (Eigen::Vector2d(x, y) - centre).squaredNorm();
      image.at(x, y) = static_cast<std::uint8_t>(std::lround(250 * std::exp(-d2 / 50.0)));
    }
  }
  return image;
}

double row_of(const GrayImage& image) {
  double sum = 0, rows = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      sum += image.at(x, y);
      rows += static_cast<double>(image.at(x, y)) * y;
    }
  }
  return rows / sum;
}

/// Where the true pair sees a point: u, v, u_right, v_right.
Eigen::Vector4d seen(const RigCorrection& rig, const Eigen::Vector3d& p_c) {
  const Prediction p = predict(kKitti, rig, p_c, false);
  return {p.value[0], p.value[1], p.value[0] - p.value[2], p.value[1] + p.value[3]};
}

/// Largest difference of rows, px, of points in images rectified by a rig; `rig` makes the images.
double worst_row(const StereoRig& with, const RigCorrection& rig) {
  const StereoRectifier rectifier(with.left, with.right, with.name);
  double worst = 0;
  for (const auto& [u, v, depth] : std::vector<std::array<double, 3>>{{200, 60, 200},
                                                                      {1150, 60, 200},
                                                                      {180, 320, 200},
                                                                      {1150, 320, 200},
                                                                      {650, 190, 200},
                                                                      {300, 80, 10},
                                                                      {1100, 300, 10},
                                                                      {700, 320, 6}}) {
    const Eigen::Vector4d at = seen(rig, kKitti.back_project(u, v, depth));
    const GrayImage left = rectifier.rectify_left(spot_at(kKitti, at.head<2>()));
    const GrayImage right = rectifier.rectify_right(spot_at(kKitti, at.tail<2>()));
    worst = std::max(worst, std::abs(row_of(left) - row_of(right)));
  }
  return worst;
}

class RigExport : public ::testing::Test {
 protected:
  RigExport() : given_(rig_of(kKitti, "kitti")) {}

  StereoRig read_back(const std::vector<std::string>& texts) {
    std::vector<fs::path> files;
    for (const std::string& text : texts) {
      files.push_back(folder_ / (std::to_string(files.size()) + ".yaml"));
      write_text(files.back(), text);
    }
    StereoRig rig = read_stereo_rig(files);
    rig.set_image_size(kKitti.width, kKitti.height);
    return rig;
  }

  TemporaryFolder folder_;
  StereoRig given_;
};

TEST_F(RigExport, WithoutACorrectionItIsTheGivenPair) {
  const RigCorrection none(kKitti, RigCorrection::Parameters::Zero());
  const FittedRig fitted = fit_rig(given_, kKitti, none);
  EXPECT_LT(fitted.largest, 1e-4);
  EXPECT_NEAR(fitted.rig.left.fx, kKitti.fx, 1e-3);
  EXPECT_NEAR(fitted.rig.baseline(), kKitti.baseline, 1e-6);
}

TEST_F(RigExport, EveryFormatGivesEqualRows) {
  // A correction is of first order; as large as on KITTI it is no exact rotation any more.
  for (const double share : {0.5, 1.0}) {
    SCOPED_TRACE(share);
    const RigCorrection rig = kitti_correction(share);
    const FittedRig five = fit_rig(given_, kKitti, rig, 5);
    const FittedRig four = fit_rig(given_, kKitti, rig, 4);
    EXPECT_LT(five.rms, 0.01) << "px";
    EXPECT_LE(five.rms, four.rms);
    EXPECT_EQ(five.rig.left.distortion.size(), 5);
    EXPECT_EQ(four.rig.right.distortion.size(), 4);
    const auto infos = to_camera_info(five.rig);
    const double most = share < 1 ? 0.02 : five.largest;  // px
    EXPECT_LT(worst_row(read_back({to_opencv(five.rig)}), rig), most);
    EXPECT_LT(worst_row(read_back({to_kalibr(four.rig)}), rig), most);
    EXPECT_LT(worst_row(read_back({infos[0], infos[1]}), rig), most);
    // Nothing is lost in the files.
    const StereoRig back = read_back({to_opencv(five.rig)});
    EXPECT_EQ(back.right.fx, five.rig.right.fx);
    EXPECT_EQ(back.right.distortion, five.rig.right.distortion);
    EXPECT_NEAR(back.baseline(), five.rig.baseline(), 1e-12);
  }
}

TEST_F(RigExport, TheGivenPairHasNotEqualRows) {
  const RigCorrection rig = kitti_correction();
  const Eigen::Vector4d at = seen(rig, kKitti.back_project(180, 320, 200));
  EXPECT_GT(std::abs(at[1] - at[3]), 0.3) << "px: what the export puts right";
}

TEST_F(RigExport, OfRawCamerasItIsTheRawImagesThatCount) {
  // The same pair as raw cameras with lenses: the correction refers to the rectified one.
  StereoRig raw = given_;
  raw.left.distortion = {-0.28, 0.07, 0.0002, 0.00002};
  raw.right.distortion = {-0.281, 0.072, -0.0001, -0.00003};
  raw.right.T_b_s.rotation = so3_exp(Eigen::Vector3d(0.01, 0.004, -0.006));
  for (const LensModel lens : {LensModel::kRadialTangential, LensModel::kEquidistant}) {
    raw.left.lens = raw.right.lens = lens;
    if (lens == LensModel::kEquidistant) {
      raw.left.distortion = {-0.01, 0.005, -0.003, 0.001};
      raw.right.distortion = {-0.012, 0.006, -0.003, 0.001};
    }
    const StereoCamera rectified = StereoRectifier(raw.left, raw.right, raw.name).camera();
    const RigCorrection none(rectified, RigCorrection::Parameters::Zero());
    const FittedRig same = fit_rig(raw, rectified, none, 5);
    EXPECT_LT(same.largest, 0.01) << "px";
    EXPECT_NEAR(same.rig.right.fx, raw.right.fx, 0.1);
    EXPECT_LT(rotation_angle(same.rig.right.T_b_s.inverse() * raw.right.T_b_s), 1e-4);
    RigCorrection::Parameters small = RigCorrection::Parameters::Zero();
    small[static_cast<int>(RigParameter::kRoll)] = 0.001;
    small[static_cast<int>(RigParameter::kRow)] = 0.5;
    const FittedRig turned = fit_rig(raw, rectified, RigCorrection(rectified, small), 5);
    EXPECT_LT(turned.rms, 0.02) << "px";
    EXPECT_GT(rotation_angle(turned.rig.right.T_b_s.inverse() * raw.right.T_b_s), 5e-4);
  }
  EXPECT_THROW((void)to_opencv(raw), InputError) << "equidistant";
  EXPECT_NE(to_kalibr(raw).find("equidistant"), std::string::npos);
}

TEST_F(RigExport, TheProgramReadsWhatCalibrateRigWrites) {
  const std::string file = (folder_ / "r.yaml").string();
  write_text(file,
             to_yaml(given_) + to_yaml(CorrectionFile{kKitti, {kitti_correction(), rig_prior()}}));
  const std::string out = (folder_ / "o.yaml").string(), more = (folder_ / "p.yaml").string();
  for (const char* format : {"opencv", "kalibr"}) {
    Command command("export_rig", {file, "--format", format, "-o", out});
    ASSERT_EQ(command.wait(), 0) << command.err();
    EXPECT_NE(command.out().find("largest residual"), std::string::npos);
    EXPECT_GT(read_stereo_rig(std::vector<fs::path>{out}).baseline(), 0.5);
  }
  Command infos("export_rig", {file, "--format", "camera_info", "-o", out, more});
  ASSERT_EQ(infos.wait(), 0) << infos.err();
  EXPECT_GT(read_stereo_rig(std::vector<fs::path>{out, more}).baseline(), 0.5);

  write_text(folder_ / "plain.yaml", to_yaml(given_));
  for (const std::vector<std::string>& bad :
       {std::vector<std::string>{file, "--format", "camera_info", "-o", out},
        {file, "--format", "opencv", "-o", out, more},
        {file, "--format", "opencv", "-o", file},
        {file, "--format", "pdf", "-o", out},
        {(folder_ / "plain.yaml").string(), "--format", "opencv", "-o", out},
        {(folder_ / "none.yaml").string(), "--format", "opencv", "-o", out}}) {
    Command command("export_rig", bad);
    EXPECT_EQ(command.wait(), 2);
    EXPECT_EQ(testing::count_lines(command.err()), 1) << command.err();
  }
}

}  // namespace
}  // namespace kys_slam
