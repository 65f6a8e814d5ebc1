// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/rig_rows.h>

#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

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

/// Rows of points in the pair that OpenCV rectifies, as StereoRectifier does: left, right.
class RectifiedRows {
 public:
  explicit RectifiedRows(const StereoRig& rig) : rig_(rig) {
    const Rigid3 T = rig.right.T_b_s.inverse() * rig.left.T_b_s;
    cv::Matx33d R;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) R(i, j) = T.R()(i, j);
    }
    cv::Mat Q;
    cv::stereoRectify(matrix(rig.left), rig.left.distortion, matrix(rig.right),
                      rig.right.distortion, cv::Size(rig.left.width, rig.left.height), R,
                      cv::Vec3d(T.t().x(), T.t().y(), T.t().z()), R_[0], R_[1], P_[0], P_[1], Q,
                      cv::CALIB_ZERO_DISPARITY, 0.0);
  }
  [[nodiscard]] double row(int side, double u, double v) const {
    const RawCamera& c = side == 0 ? rig_.left : rig_.right;
    std::vector<cv::Point2d> out;
    cv::undistortPoints(std::vector<cv::Point2d>{{u, v}}, out, matrix(c), c.distortion, R_[side],
                        P_[side], cv::TermCriteria(cv::TermCriteria::COUNT, 50, 0));
    return out[0].y;
  }

 private:
  static cv::Matx33d matrix(const RawCamera& c) { return {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1}; }
  const StereoRig& rig_;
  cv::Mat R_[2], P_[2];
};

/// Largest difference of rows, px, of points in images of `rig` rectified by `with`.
double worst_row(const StereoRig& with, const RigCorrection& rig) {
  const RectifiedRows rows(with);
  double worst = 0;
  for (double u = 80; u < kKitti.width; u += 95) {
    for (double v = 10; v < kKitti.height; v += 44) {
      for (const double depth : {8.0, 30.0, 1000.0}) {
        const Eigen::Vector4d at = seen(rig, kKitti.back_project(u, v, depth));
        if (at[2] < 0) continue;
        worst = std::max(worst, std::abs(rows.row(0, at[0], at[1]) - rows.row(1, at[2], at[3])));
      }
    }
  }
  return worst;
}

/// The same of the images that StereoRectifier makes; its positions are rounded to 1/32 px.
double worst_row_in_images(const StereoRig& with, const RigCorrection& rig) {
  const StereoRectifier rectifier(with.left, with.right, with.name);
  double worst = 0;
  for (const auto& [u, v, depth] : std::vector<std::array<double, 3>>{
           {200, 60, 200}, {1100, 60, 200}, {180, 310, 200}, {650, 190, 200}, {1000, 300, 10}}) {
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
    EXPECT_LT(worst_row_in_images(read_back({to_opencv(five.rig)}), rig), most + 1.0 / 32);
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
