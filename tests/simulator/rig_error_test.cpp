// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/rig_error.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <vector>

#include "scratch_folder.h"
#include "support/option_walk.h"

namespace kys_slam::simulator {
namespace {

const StereoCamera kKitti{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};
const StereoCamera kPlain{1200, 400, 700, 700, 600, 200, 0.5};

/// Points before the camera: image positions by depths, m.
std::vector<Eigen::Vector3d> points_before(const StereoCamera& camera) {
  std::vector<Eigen::Vector3d> points;
  for (double u = 5; u < camera.width; u += 111) {
    for (double v = 5; v < camera.height; v += 61) {
      for (const double depth : {3.0, 12.0, 80.0, 1e6}) {
        points.push_back(camera.back_project(u, v, depth));
      }
    }
  }
  return points;
}

TEST(Lens, IsOpenCVs) {
  const Lens lens{500, 510, 320, 240, {-0.28, 0.07, 0.002, -0.003}};
  const cv::Matx33d K(500, 0, 320, 0, 510, 240, 0, 0, 1);
  const std::vector<double> distortion{-0.28, 0.07, 0.002, -0.003};
  for (const auto& [x, y] : std::vector<std::pair<double, double>>{
           {0, 0}, {0.3, -0.1}, {-0.5, 0.4}, {0.6, 0.45}, {-0.2, -0.4}}) {
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}}, cv::Vec3d(), cv::Vec3d(), K, distortion,
                      pixels);
    EXPECT_NEAR(lens.project(x, y).x(), pixels[0].x, 1e-9);
    EXPECT_NEAR(lens.project(x, y).y(), pixels[0].y, 1e-9);
    EXPECT_LT((lens.ray(pixels[0].x, pixels[0].y) - Eigen::Vector2d(x, y)).norm(), 1e-9);
  }
}

TEST(TruePair, MapsBothWays) {
  for (const char* name : {"kitti", "random:1", "random:2", "random:3", "random:4"}) {
    SCOPED_TRACE(name);
    const TruePair pair(kKitti, make_rig_error(name, kKitti));
    double moved = 0;
    for (const Eigen::Vector3d& p : points_before(kKitti)) {
      const Eigen::Vector3d ideal = kKitti.project_stereo(p);
      const Eigen::Vector4d seen = pair.observe(p);
      moved = std::max(moved, std::abs(seen[3] - seen[1]));
      EXPECT_LT((pair.left_ideal(seen[0], seen[1]) - ideal.head<2>()).norm(), 1e-6);
      const auto back = pair.pair_ideal(seen[0], seen[1], seen[2], seen[3]);
      EXPECT_NEAR(back.u, ideal[0], 1e-6);
      EXPECT_NEAR(back.v, ideal[1], 1e-6);
      EXPECT_NEAR(back.u_right, ideal[2], 1e-6);
      EXPECT_NEAR(back.row_difference, 0, 1e-6);
    }
    EXPECT_GT(moved, 0.5) << "px between the rows of the true pair";
  }
}

TEST(TruePair, OfPointsAtInfinityTheRightPixelIsEnough) {
  const TruePair pair(kKitti, make_rig_error("random:5", kKitti));
  for (const double u : {20.0, 600.0, 1200.0}) {
    const Eigen::Vector3d p = kKitti.back_project(u, 300, 1e9);
    const Eigen::Vector4d seen = pair.observe(p);
    EXPECT_LT((pair.right_ideal_far(seen[2], seen[3]) - Eigen::Vector2d(u, 300)).norm(), 1e-6);
  }
}

TEST(TruePair, WithoutErrorIsTheGivenPair) {
  const TruePair pair(kKitti, {});
  for (const Eigen::Vector3d& p : points_before(kKitti)) {
    const Eigen::Vector3d ideal = kKitti.project_stereo(p);
    EXPECT_LT((pair.observe(p) - Eigen::Vector4d(ideal[0], ideal[1], ideal[2], ideal[1])).norm(),
              1e-9);
  }
  const auto apart = pair.pair_ideal(700, 100, 680, 100.75);
  EXPECT_NEAR(apart.u_right, 680, 1e-9);
  EXPECT_NEAR(apart.row_difference, 0.75, 1e-9);
}

// By hand, with f = 700, c = (600, 200), baseline 0.5 m.
TEST(TruePair, YawTurnsTheRightCamera) {
  RigError error;
  error.yaw = 0.02;  // about y (down): the optical axis moves to +x, what it sees to the left
  const TruePair pair(kPlain, error);
  const double s = std::sin(0.02), c = std::cos(0.02);
  const Eigen::Vector4d ahead = pair.observe({0, 0, 1e12});
  EXPECT_NEAR(ahead[2], 600 - 700 * s / c, 1e-6);
  EXPECT_NEAR(ahead[3], 200, 1e-6);
  const Eigen::Vector4d aside = pair.observe(Eigen::Vector3d(0.5, 0.2, 1) * 1e12);
  EXPECT_NEAR(aside[0], 950, 1e-6);
  EXPECT_NEAR(aside[1], 340, 1e-6);
  EXPECT_NEAR(aside[2], 600 + 700 * (0.5 * c - s) / (c + 0.5 * s), 1e-6);
  EXPECT_NEAR(aside[3], 200 + 700 * 0.2 / (c + 0.5 * s), 1e-6);
}

TEST(TruePair, PitchAndRollTurnTheRightCamera) {
  RigError error;
  error.pitch = 0.01;  // about x: the optical axis moves up, what it sees down
  EXPECT_NEAR(TruePair(kPlain, error).observe({0, 0, 1e12})[3], 200 + 700 * std::tan(0.01), 1e-6);
  error = {};
  error.roll = 0.01;  // about z, clockwise: what it sees turns counter-clockwise
  const Eigen::Vector4d seen = TruePair(kPlain, error).observe(Eigen::Vector3d(0.5, 0.2, 1) * 1e12);
  const double s = std::sin(0.01), c = std::cos(0.01);
  EXPECT_NEAR(seen[2], 600 + 700 * (0.5 * c + 0.2 * s), 1e-6);
  EXPECT_NEAR(seen[3], 200 + 700 * (0.2 * c - 0.5 * s), 1e-6);
}

TEST(TruePair, RotationsAreAppliedInTheirOrder) {
  RigError error;
  error.yaw = 0.03;
  error.pitch = -0.02;
  error.roll = 0.01;
  const auto about = [](double angle, int axis) {
    return Eigen::AngleAxisd(angle, Eigen::Vector3d::Unit(axis)).toRotationMatrix();
  };
  const Eigen::Matrix3d R = about(0.03, 1) * about(-0.02, 0) * about(0.01, 2);
  EXPECT_LT((TruePair(kPlain, error).T_left_right().R() - R).norm(), 1e-12);
}

TEST(TruePair, PositionOfTheRightCamera) {
  RigError error;
  error.baseline_y = 0.01;  // 5 mm lower
  const TruePair lower(kPlain, error);
  const Eigen::Vector4d seen = lower.observe({1, 0.5, 10});
  EXPECT_NEAR(seen[1], 200 + 700 * 0.05, 1e-9);
  EXPECT_NEAR(seen[2], 600 + 700 * 0.05, 1e-9);
  EXPECT_NEAR(seen[3] - seen[1], -700 * 0.005 / 10, 1e-9);
  error = {};
  error.baseline_z = 0.1;  // 5 cm ahead
  const Eigen::Vector4d ahead = TruePair(kPlain, error).observe({1, 0.5, 10});
  EXPECT_NEAR(ahead[2], 600 + 700 * 0.5 / 9.95, 1e-9);
  EXPECT_NEAR(ahead[3], 200 + 700 * 0.5 / 9.95, 1e-9);
}

TEST(TruePair, BaselineTimesFocalLengthIsKept) {
  RigError error;
  error.focal = 0.99;
  const TruePair pair(kPlain, error);
  const Eigen::Vector4d seen = pair.observe({1, 0.5, 10});
  EXPECT_NEAR(seen[0], 600 + 0.99 * 70, 1e-9);
  EXPECT_NEAR(seen[0] - seen[2], 700 * 0.5 / 10, 1e-9);
  const Eigen::Vector2d ideal = pair.left_ideal(seen[0], seen[1]);
  EXPECT_NEAR(ideal.x(), 670, 1e-9);
  EXPECT_NEAR(ideal.y(), 235, 1e-9);
}

TEST(TruePair, PrincipalPointAndFocalRatioAreTheRightCameras) {
  RigError error;
  error.focal_ratio = 1.01;
  error.cx = 3;
  error.cy = -2;
  const Eigen::Vector4d seen = TruePair(kPlain, error).observe(Eigen::Vector3d(0.1, 0.2, 1) * 1e12);
  EXPECT_LT((seen - Eigen::Vector4d(670, 340, 603 + 70.7, 198 + 141.4)).norm(), 1e-6);
}

// Row in the right image - row in the left one of points at infinity.
TEST(KittiRigError, HasTheFieldMeasuredOnKitti01) {
  const double measured[4][6] = {{1.20, 0.76, 0.36, -0.18, -0.64, -1.16},
                                 {0.63, 0.46, 0.30, 0.03, -0.26, -0.49},
                                 {-0.03, 0.14, 0.27, 0.26, 0.12, 0.11},
                                 {-0.58, -0.23, 0.18, 0.47, 0.58, 0.93}};
  const TruePair pair(kKitti, make_rig_error("kitti", kKitti));
  double all = 0, left_over = 0;
  for (int row = 0; row < 4; ++row) {
    std::string text;
    for (int column = 0; column < 6; ++column) {
      const double u = (column + 0.5) * 1241 / 6, v = (row + 0.5) * 376 / 4;
      const Eigen::Vector2d ideal = pair.left_ideal(u, v);
      const Eigen::Vector4d seen = pair.observe(kKitti.back_project(ideal.x(), ideal.y(), 1e12));
      const double modelled = seen[3] - v;
      all += std::pow(measured[row][column], 2);
      left_over += std::pow(measured[row][column] - modelled, 2);
      char number[16];
      std::snprintf(number, sizeof number, " %6.2f", modelled);
      text += number;
    }
    std::printf("%s\n", text.c_str());
  }
  EXPECT_LT(left_over, all / 10);
  // The yaw alone would shift the columns by 17 px.
  const Eigen::Vector4d centre = pair.observe({0, 0, 1e12});
  EXPECT_LT(std::abs(centre[2] - centre[0]), 1.0);
}

TEST(KittiRigError, ScalesWithTheImage) {
  StereoCamera half = kKitti;
  half.fx = half.fy = kKitti.fx / 2;
  half.width = 620;
  half.height = 188;
  const RigError full_size = make_rig_error("kitti", kKitti),
                 half_size = make_rig_error("kitti", half);
  EXPECT_EQ(full_size.yaw, half_size.yaw);
  EXPECT_NEAR(half_size.cx, full_size.cx / 2, 1e-12);
}

double deviation(const std::vector<double>& values) {
  double sum = 0;
  for (const double x : values) sum += x * x;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

TEST(RandomRigError, IsOfTheMagnitudeStated) {
  std::vector<double> k1_left, k1_right, p, turn, u, v, ratio, focal, offset;
  double common = 0;
  for (int seed = 0; seed < 400; ++seed) {
    const RigError e = make_rig_error("random:" + std::to_string(seed), kKitti);
    EXPECT_EQ(e, make_rig_error("random:" + std::to_string(seed), kKitti));
    k1_left.push_back(e.left[0]);
    k1_right.push_back(e.right[0]);
    common += e.left[0] * e.right[0];
    p.insert(p.end(), {e.left[2], e.left[3], e.right[2], e.right[3]});
    turn.insert(turn.end(), {e.yaw, e.pitch, e.roll});
    const Eigen::Vector4d centre = TruePair(kKitti, e).observe({0, 0, 1e12});
    u.push_back(centre[2] - centre[0]);
    v.push_back(centre[3] - centre[1]);
    ratio.push_back(e.focal_ratio - 1);
    focal.push_back(e.focal - 1);
    offset.insert(offset.end(), {e.baseline_y, e.baseline_z});
    EXPECT_EQ(e.left[1], 0);
    EXPECT_EQ(e.right[1], 0);
  }
  // The deviation of 400 draws is exact to 3.5 %.
  const auto expect_deviation = [](const std::vector<double>& values, double sigma) {
    EXPECT_NEAR(deviation(values) / sigma, 1, 0.14);
  };
  expect_deviation(k1_left, 0.008);
  expect_deviation(k1_right, 0.008);
  EXPECT_NEAR(common / 400 / (0.008 * 0.008), 0.7, 0.2);
  expect_deviation(p, 0.0015);
  expect_deviation(turn, 0.002);
  expect_deviation(u, 0.3);
  expect_deviation(v, 0.5);
  expect_deviation(ratio, 0.0008);
  expect_deviation(focal, 0.004);
  expect_deviation(offset, 0.003);
}

TEST(RigErrorFile, IsReadAsWritten) {
  const ScratchFolder scratch("rig_error");
  const RigError error = make_rig_error("random:5", kKitti);
  std::ofstream(scratch / "a.yaml") << to_yaml(error);
  EXPECT_EQ(make_rig_error((scratch / "a.yaml").string(), kKitti), error);
  std::ofstream(scratch / "b.yaml")
      << "right: {yaw: 0.003, focal_ratio: 1.001}\nleft: {k1: -1e-3}\n";
  RigError expected;
  expected.yaw = 0.003;
  expected.focal_ratio = 1.001;
  expected.left[0] = -1e-3;
  EXPECT_EQ(make_rig_error((scratch / "b.yaml").string(), kKitti), expected);
  std::ofstream(scratch / "empty.yaml") << "";
  EXPECT_EQ(make_rig_error((scratch / "empty.yaml").string(), kKitti), RigError{});
}

TEST(RigErrorFile, WhatIsWrongIsSaidInOneLine) {
  const ScratchFolder scratch("rig_error_bad");
  const auto message = [](const std::string& text) -> std::string {
    try {
      make_rig_error(text, kKitti);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  const std::vector<std::pair<std::string, std::string>> bad = {
      {"focal: .nan", "focal"},
      {"focal: .inf", "focal"},
      {"focal: 0", "focal"},
      {"focal: 3", "focal"},
      {"focal: long", "focal"},
      {"focal: [1, 1]", "focal"},
      {"right: {yaw: 1}", "right.yaw"},
      {"right: {jaw: 0.01}", "right.yaw"},  // what was meant
      {"left: {yaw: 0.01}", "left.yaw"},
      {"left: {k1: 1e9}", "left.k1"},
      {"right: {cx: -1e300}", "right.cx"},
      {"left: {k1: 0, k1: 0}", "k1"},
      {"baseline: 0.5", "baseline"},
      {"- 1\n- 2", "list"},
      {"left: {k1: 0", "bad.yaml"},
  };
  for (const auto& [content, mention] : bad) {
    std::ofstream(scratch / "bad.yaml") << content << "\n";
    const std::string text = message((scratch / "bad.yaml").string());
    EXPECT_NE(text.find("bad.yaml"), std::string::npos) << content << ": " << text;
    EXPECT_NE(text.find(mention), std::string::npos) << content << ": " << text;
    EXPECT_EQ(text.find('\n'), std::string::npos) << content << ": " << text;
  }
  EXPECT_NE(message((scratch / "none.yaml").string()).find("none.yaml"), std::string::npos);
  EXPECT_NE(message((scratch / "").string()), "");
  for (const char* name :
       {"random:", "random:x", "random:-1", "random:1.5", "random:99999999999999999999"}) {
    EXPECT_NE(message(name).find(name), std::string::npos) << message(name);
  }
}

TEST(RigErrorFile, EveryNumberIsChecked) {
  // The lenses are two fields with four numbers each.
  EXPECT_EQ(test::listed<RigError>() - 6, test::field_count<RigError>());
  test::expect_numbers_checked(RigError{});
}

TEST(TruePair, DistortionThatFoldsTheImageIsRefused) {
  RigError error;
  error.left[0] = -0.1;
  EXPECT_NO_THROW(TruePair(kKitti, error));
  StereoCamera tall = kKitti;  // 82 degrees up and down
  tall.height = 10000;
  tall.cy = 5000;
  EXPECT_THROW(TruePair(tall, error), InputError);
}

}  // namespace
}  // namespace kys_slam::simulator
