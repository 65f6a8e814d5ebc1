// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/stereo_rig.h>

#include "temporary_folder.h"

// Settings that users of ORB-SLAM2 and ORB-SLAM3 bring as the calibration of their camera.
namespace kys_slam {
namespace {

class OrbSlamSettings : public testing::Test {
 protected:
  StereoRig read(const std::string& text, double unit = 1) {
    write_text(folder_ / "mine.yaml", "%YAML:1.0\n#-----\n" + text);
    return read_stereo_rig(std::vector<std::filesystem::path>{folder_ / "mine.yaml"}, unit);
  }
  TemporaryFolder folder_;
};

const std::string kSize = "Camera.width: 752\nCamera.height: 480\nCamera.fps: 20\n";
const std::string kPinhole =
    "File.version: \"1.0\"\nCamera.type: \"PinHole\"\n"
    "Camera1.fx: 458.654\nCamera1.fy: 457.296\nCamera1.cx: 367.215\nCamera1.cy: 248.375\n"
    "Camera1.k1: -0.28340811\nCamera1.k2: 0.07395907\nCamera1.p1: 0.00019359\n"
    "Camera1.p2: 1.76187114e-05\n"
    "Camera2.fx: 457.587\nCamera2.fy: 456.134\nCamera2.cx: 379.999\nCamera2.cy: 255.238\n"
    "Camera2.k1: -0.28368365\nCamera2.k2: 0.07451284\nCamera2.p1: -0.00010473\n"
    "Camera2.p2: -3.55590700e-05\n" +
    kSize;
/// The right camera is 0.11 m to the right, turned by 90 degrees about the optical axis.
const std::string kPose =
    "Stereo.ThDepth: 60.0\nStereo.T_c1_c2: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: f\n"
    "  data: [0.0, -1.0, 0.0, 0.11,\n         1.0, 0.0, 0.0, 0.02,\n         0.0, 0.0, 1.0, 0.0,\n"
    "         0.0, 0.0, 0.0, 1.0]\nORBextractor.nFeatures: 1200\n";

TEST_F(OrbSlamSettings, RawPinholeCameras) {
  const StereoRig rig = read(kPinhole + kPose);
  EXPECT_EQ(rig.left.width, 752);
  EXPECT_EQ(rig.right.height, 480);
  EXPECT_DOUBLE_EQ(rig.left.fx, 458.654);
  EXPECT_DOUBLE_EQ(rig.right.cy, 255.238);
  EXPECT_EQ(rig.left.lens, LensModel::kRadialTangential);
  EXPECT_EQ(rig.right.distortion,
            (std::vector<double>{-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05}));
  const Rigid3 T_left_right = rig.left.T_b_s.inverse() * rig.right.T_b_s;
  const Eigen::Vector3d seen = T_left_right * Eigen::Vector3d(1, 2, 3);
  EXPECT_TRUE(seen.isApprox(Eigen::Vector3d(-2 + 0.11, 1 + 0.02, 3), 1e-12)) << seen.transpose();
  EXPECT_FALSE(rig.rectified());
}

TEST_F(OrbSlamSettings, FisheyeCamerasHaveFourCoefficients) {
  std::string text = kPinhole + kPose;
  const auto replace = [&](const std::string& from, const std::string& to) {
    for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + 1)) {
      text.replace(at, from.size(), to);
    }
  };
  replace("PinHole", "KannalaBrandt8");
  expect_input_error([&] { read(text); }, {"mine.yaml", "k3 and k4"});
  replace(".p1", ".k3");
  replace(".p2", ".k4");
  const StereoRig rig = read(text);
  EXPECT_EQ(rig.right.lens, LensModel::kEquidistant);
  EXPECT_DOUBLE_EQ(rig.right.distortion.at(2), -0.00010473);
}

TEST_F(OrbSlamSettings, RectifiedPairsOfBothVersions) {
  const std::string three =
      "Camera.type: \"Rectified\"\nCamera1.fx: 700\nCamera1.fy: 700\nCamera1.cx: 370\n"
      "Camera1.cy: 240\nStereo.b: 0.5\n" +
      kSize;
  const std::string two =
      "Camera.fx: 700\nCamera.fy: 700\nCamera.cx: 370\nCamera.cy: 240\nCamera.k1: 0.0\n"
      "Camera.bf: 350\n" +
      kSize;
  for (const std::string& text : {three, two}) {
    const auto camera = read(text).rectified();
    ASSERT_TRUE(camera) << text;
    EXPECT_DOUBLE_EQ(camera->fx, 700);
    EXPECT_NEAR(camera->baseline, 0.5, 1e-12);
    EXPECT_EQ(camera->width, 752);
    EXPECT_NEAR(read(text, 0.1).baseline(), 0.05, 1e-12);
  }
}

TEST_F(OrbSlamSettings, RawCamerasOfVersionTwoAreThoseOfCameraInfo) {
  const auto camera = [](const std::string& side, const char* tx) {
    const auto matrix = [&](const char* key, int rows, int columns, const std::string& data) {
      return side + "." + key + ": !!opencv-matrix\n   rows: " + std::to_string(rows) +
             "\n   cols: " + std::to_string(columns) + "\n   dt: d\n   data: [" + data + "]\n";
    };
    return side + ".height: 480\n" + side + ".width: 752\n" +
           matrix("D", 1, 5, "-0.28, 0.07, 0.0002, 1.8e-05, 0.0") +
           matrix("K", 3, 3, "458, 0, 367, 0, 457, 248, 0, 0, 1") +
           matrix("R", 3, 3, "1, 0, 0, 0, 1, 0, 0, 0, 1") +
           matrix("P", 3, 4, std::string("435, 0, 367, ") + tx + ", 0, 435, 252, 0, 0, 0, 1, 0");
  };
  const std::string text =
      "Camera.fx: 435\nCamera.fy: 435\nCamera.cx: 367\nCamera.cy: 252\n"
      "Camera.bf: 47.9\n" +
      kSize + camera("LEFT", "0") + camera("RIGHT", "-47.85");
  const StereoRig rig = read(text);
  EXPECT_DOUBLE_EQ(rig.left.fx, 458);
  EXPECT_NEAR(rig.baseline(), 0.11, 1e-9);
  EXPECT_EQ(rig.left.distortion, (std::vector<double>{-0.28, 0.07, 0.0002, 1.8e-05, 0}));
}

TEST_F(OrbSlamSettings, WhatIsMissingIsNamed) {
  expect_input_error([&] { read(kPinhole); }, {"mine.yaml", "Stereo.T_c1_c2"});
  expect_input_error([&] { read("Camera1.fx: 1\n"); }, {"mine.yaml", "Camera1.fy"});
  expect_input_error([&] { read("Camera.fx: 7\nCamera.fy: 7\nCamera.cx: 3\nCamera.cy: 2\n"); },
                     {"Camera.bf", "single camera"});
  expect_input_error(
      [&] {
        read(
            "Camera.fx: 7\nCamera.fy: 7\nCamera.cx: 3\nCamera.cy: 2\nCamera.k1: 0.1\nCamera.bf: "
            "4\n");
      },
      {"rectified", "LEFT.K"});
  std::string other = kPinhole + kPose;
  other.replace(other.find("PinHole"), 7, "Omni");
  expect_input_error([&] { read(other); }, {"Camera.type", "Omni"});
}

}  // namespace
}  // namespace kys_slam
