// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/stereo_rectifier.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "camera/kitti_calibration.h"

namespace kys_slam {
namespace {

/// The published calibration of EuRoC's cameras.
RawCamera euroc_camera(bool right) {
  Eigen::Matrix3d R;
  RawCamera c;
  c.width = 752;
  c.height = 480;
  if (right) {
    R << 0.0125552670891, -0.999755099723, 0.0182237714554, 0.999598781151, 0.0130119051815,
        0.0251588363115, -0.0253898008918, 0.0179005838253, 0.999517347078;
    c.T_b_s = {R, {-0.0198435579556, 0.0453689425024, 0.00786212447038}};
    c.fx = 457.587, c.fy = 456.134, c.cx = 379.999, c.cy = 255.238;
    c.distortion = {-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05};
  } else {
    R << 0.0148655429818, -0.999880929698, 0.00414029679422, 0.999557249008, 0.0149672133247,
        0.025715529948, -0.0257744366974, 0.00375618835797, 0.999660727178;
    c.T_b_s = {R, {-0.0216401454975, -0.064676986768, 0.00981073058949}};
    c.fx = 458.654, c.fy = 457.296, c.cx = 367.215, c.cy = 248.375;
    c.distortion = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05};
  }
  return c;
}

/// Raw pixel of a point in the body frame: pinhole with radial-tangential distortion.
Eigen::Vector2d project_raw(const RawCamera& c, const Eigen::Vector3d& p_b) {
  const Eigen::Vector3d p = c.T_b_s.inverse() * p_b;
  const double x = p.x() / p.z(), y = p.y() / p.z(), r2 = x * x + y * y;
  const auto& d = c.distortion;
  const double radial = 1 + d[0] * r2 + d[1] * r2 * r2;
  const double xd = x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x);
  const double yd = y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y;
  return {c.fx * xd + c.cx, c.fy * yd + c.cy};
}

/// An image with one soft round spot.
GrayImage spot(int width, int height, const Eigen::Vector2d& centre) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double d2 = (Eigen::Vector2d(x, y) - centre).squaredNorm();
      image.at(x, y) = static_cast<std::uint8_t>(std::lround(250 * std::exp(-d2 / 18.0)));
    }
  }
  return image;
}

Eigen::Vector2d centroid(const GrayImage& image) {
  Eigen::Vector2d sum(0, 0);
  double weight = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      sum += image.at(x, y) * Eigen::Vector2d(x, y);
      weight += image.at(x, y);
    }
  }
  return sum / weight;
}

// Printed by OpenCV 4.6, stereoRectify() with CALIB_ZERO_DISPARITY and alpha 0.
TEST(StereoRectifier, HasTheIntrinsicsOfOpenCv) {
  const StereoRectifier rectifier(euroc_camera(false), euroc_camera(true), "euroc");
  constexpr double kFloat = 1e-4;  // px; it rounds positions in the image to float
  EXPECT_NEAR(rectifier.camera().fx, 436.23458640269558, kFloat);
  EXPECT_EQ(rectifier.camera().fy, rectifier.camera().fx);
  EXPECT_NEAR(rectifier.camera().cx, 364.44122314453125, kFloat);
  EXPECT_NEAR(rectifier.camera().cy, 256.95167541503906, kFloat);
  EXPECT_NEAR(rectifier.camera().baseline, 0.11007784207007308, 1e-14);
}

TEST(StereoRectifier, SpotsLandWhereTheRectifiedPairSeesThem) {
  const RawCamera left = euroc_camera(false), right = euroc_camera(true);
  const StereoRectifier rectifier(left, right, "rig");
  const StereoCamera& camera = rectifier.camera();
  EXPECT_TRUE(camera.is_valid());
  EXPECT_EQ(camera.width, 752);
  EXPECT_EQ(camera.height, 480);
  for (const Eigen::Vector3d& p_c :
       {Eigen::Vector3d(0, 0, 4), Eigen::Vector3d(-1.5, 0.8, 3), Eigen::Vector3d(2, -1.2, 5)}) {
    const Eigen::Vector3d p_b = rectifier.T_b_c() * p_c;
    const Eigen::Vector3d expected = camera.project_stereo(p_c);  // u_left, v, u_right
    const auto l = centroid(rectifier.rectify_left(spot(752, 480, project_raw(left, p_b))));
    const auto r = centroid(rectifier.rectify_right(spot(752, 480, project_raw(right, p_b))));
    // Distortion stretches a spot by a few per cent, so its centroid is good to a twentieth.
    EXPECT_NEAR(l.x(), expected(0), 0.1);
    EXPECT_NEAR(l.y(), expected(1), 0.1);
    EXPECT_NEAR(r.x(), expected(2), 0.1);
    EXPECT_NEAR(r.y(), expected(1), 0.1);
  }
}

TEST(StereoRectifier, AMapTakesTheNumberOfTheNearestPixel) {
  const RawCamera left = euroc_camera(false);
  const StereoRectifier rectifier(left, euroc_camera(true), "rig");
  ImageOf<std::uint16_t> columns(752, 480), rows(752, 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 752; ++x) {
      columns.at(x, y) = static_cast<std::uint16_t>(1000 + x);
      rows.at(x, y) = static_cast<std::uint16_t>(1000 + y);
    }
  }
  const auto u = rectifier.rectify_left_map(columns), v = rectifier.rectify_left_map(rows);
  const double half = 0.5 + 1.0 / 32;  // positions are rounded to 1/32 px
  for (const auto& [x, y] : std::vector<std::pair<int, int>>{{376, 240}, {30, 40}, {700, 450}}) {
    const Eigen::Vector3d ray = rectifier.camera().back_project(x, y, 1);
    const Eigen::Vector2d raw =
        project_raw(left, rectifier.T_b_c().rotation * ray + left.T_b_s.t());
    EXPECT_NEAR(u.at(x, y) - 1000, raw.x(), half);
    EXPECT_NEAR(v.at(x, y) - 1000, raw.y(), half);
  }
  EXPECT_THROW(static_cast<void>(rectifier.rectify_left_map(ImageOf<std::uint16_t>(752, 479))),
               InputError);
}

TEST(StereoRectifier, ACorrectionMakesThePairPerfect) {
  const StereoCamera given{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};
  RigCorrection::Parameters values;
  values << 0.0155, -0.0110, 0.0008, 0.0016, 0.0112, -0.0047, 0, -0.0068, -0.0274, 0.0023, -0.0002,
      0.0018, 0.22, -0.25, -0.003, -0.0140, -0.0073;
  const RigCorrection correction(given, values);
  const StereoRectifier rectifier(given, correction, "rig");
  const StereoCamera& camera = rectifier.camera();
  EXPECT_EQ(camera.fx, given.fx);
  EXPECT_EQ(camera.cx, given.cx);
  const double norm = std::sqrt(1 + 0.003 * 0.003 + 0.014 * 0.014);
  EXPECT_NEAR(camera.baseline, given.baseline * norm / (1 - 0.0073), 1e-12);
  double apart = 0;  // rows in the given images
  for (const auto& [u, v, depth] : std::vector<std::array<double, 3>>{
           {200, 60, 200}, {1100, 60, 200}, {180, 310, 200}, {650, 190, 30}, {1000, 300, 8}}) {
    const Eigen::Vector3d p = given.back_project(u, v, depth);
    const Eigen::Vector2d left = correction.measured_left(u, v);
    const Eigen::Vector2d right = correction.measured_right(u, v, u - given.bf() / depth);
    apart = std::max(apart, std::abs(left.y() - right.y()));
    const Eigen::Vector3d expected = camera.project_stereo(rectifier.T_b_c().inverse() * p);
    const auto l = centroid(rectifier.rectify_left(spot(1241, 376, left)));
    const auto r = centroid(rectifier.rectify_right(spot(1241, 376, right)));
    // Positions are rounded to 1/32 px, the spots' brightness to whole numbers.
    EXPECT_NEAR(l.x(), expected(0), 0.05);
    EXPECT_NEAR(l.y(), expected(1), 0.05);
    EXPECT_NEAR(r.x(), expected(2), 0.05);
    EXPECT_NEAR(r.y(), expected(1), 0.05);
  }
  EXPECT_GT(apart, 0.5) << "px: there is something to put right";
}

TEST(StereoRectifier, EveryPixelComesFromInsideTheRawImages) {
  const StereoRectifier rectifier(euroc_camera(false), euroc_camera(true), "rig");
  // White inside, a black rim: what came from outside would be as black as the rim.
  GrayImage raw(752, 480, 0);
  for (int y = 1; y < 479; ++y) {
    for (int x = 1; x < 751; ++x) raw.at(x, y) = 200;
  }
  for (const GrayImage& out : {rectifier.rectify_left(raw), rectifier.rectify_right(raw)}) {
    // Of 360960; the zoom is found on a coarse grid of points, so a few slip over the rim.
    EXPECT_LT(std::count(out.data(), out.data() + out.size(), 0), 60);
  }
  // Settings the field uses for these cameras: fx 435.2, bf 47.9 (older rectification code).
  EXPECT_NEAR(rectifier.camera().fx, 435.2, 2.0);
  EXPECT_NEAR(rectifier.camera().baseline, 47.90639 / 435.20469, 1e-6);
}

TEST(StereoRectifier, IdealCamerasAreLeftAlone) {
  RawCamera left;
  left.width = 100;
  left.height = 80;
  left.fx = left.fy = 90;
  left.cx = 49.5;
  left.cy = 39.5;
  left.distortion = {0, 0, 0, 0};
  RawCamera right = left;
  right.T_b_s.translation.x() = 0.2;
  const StereoRectifier rectifier(left, right, "rig");
  EXPECT_NEAR(rectifier.camera().baseline, 0.2, 1e-12);
  EXPECT_NEAR(rotation_angle(rectifier.T_b_c()), 0, 1e-12);
  const StereoRectifier moved = [&] {
    RawCamera l = left, r = right;
    l.T_b_s = r.T_b_s = Rigid3(so3_exp({0.1, 0.2, 0.3}), Eigen::Vector3d(1, 2, 3));
    r.T_b_s.translation += r.T_b_s.rotation * Eigen::Vector3d(0.2, 0, 0);
    return StereoRectifier(l, r, "rig");
  }();
  EXPECT_LT(minus(moved.T_b_c(), Rigid3(so3_exp({0.1, 0.2, 0.3}), {1, 2, 3})).norm(), 1e-9);
}

TEST(StereoRectifier, RefusesRigsThatAreNone) {
  const RawCamera left = euroc_camera(false), right = euroc_camera(true);
  const auto refused = [](const RawCamera& l, const RawCamera& r) {
    EXPECT_THROW(StereoRectifier(l, r, "rig"), InputError);
  };
  refused(right, left);  // swapped
  refused(left, left);   // no baseline
  RawCamera bad = right;
  bad.fx = std::numeric_limits<double>::quiet_NaN();
  refused(left, bad);
  bad = right;
  bad.distortion = {0.1};
  refused(left, bad);
  bad = right;
  bad.width = 640;
  refused(left, bad);
  bad = right;
  bad.T_b_s = left.T_b_s;
  bad.T_b_s.translation += left.T_b_s.rotation * Eigen::Vector3d(0, 0.1, 0);  // one below the other
  refused(left, bad);
  const StereoRectifier good(left, right, "rig");
  EXPECT_THROW(static_cast<void>(good.rectify_left(GrayImage(751, 480))), InputError);
}

TEST(KittiCalibration, BaselineFromTwoProjections) {
  ProjectionMatrix P2 = ProjectionMatrix::Zero(), P3;
  P2.leftCols<3>() << 721.5377, 0, 609.5593, 0, 721.5377, 172.854, 0, 0, 1;
  P3 = P2;
  P2(0, 3) = 44.85728;
  P3(0, 3) = -339.5242;
  const StereoCamera camera = stereo_camera_from_projections(P2, P3, 1242, 375, "calib.txt");
  EXPECT_NEAR(camera.baseline, 0.532725, 1e-5);
  EXPECT_DOUBLE_EQ(camera.cx, 609.5593);
  EXPECT_THROW(stereo_camera_from_projections(P3, P2, 1242, 375, "calib.txt"), InputError);
  P3(0, 0) = 700;
  EXPECT_THROW(stereo_camera_from_projections(P2, P3, 1242, 375, "calib.txt"), InputError);
  P3(0, 0) = std::numeric_limits<double>::infinity();
  EXPECT_THROW(stereo_camera_from_projections(P2, P3, 1242, 375, "calib.txt"), InputError);
}

}  // namespace
}  // namespace kys_slam
