#include <gtest/gtest.h>

#include "geometry/epipolar.h"
#include "geometry/triangulation.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

const Rigid3 kTAB(so3_exp({0.01, -0.05, 0.02}), {0.8, -0.05, 1.2});

TEST(Triangulate, RecoversPoints) {
  const StereoCamera camera = kitti_camera();
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d p_a(random.uniform(-6, 6), random.uniform(-2, 2), random.uniform(4, 25));
    const Eigen::Vector3d p_b = kTAB.inverse() * p_a;
    const auto point = triangulate(camera, kTAB, camera.project(p_a), camera.project(p_b));
    // Towards the direction of motion there is no parallax to measure depth by.
    if (point.cos_parallax > 1 - 1e-6) continue;
    ASSERT_TRUE(point.valid);
    EXPECT_LT((point.p_a - p_a).norm(), 1e-6 * p_a.squaredNorm());
    EXPECT_LT(point.error_a + point.error_b, 1e-6);
    const Eigen::Vector3d from_b = p_a - kTAB.t();
    EXPECT_NEAR(point.cos_parallax, p_a.normalized().dot(from_b.normalized()), 1e-12);
  }
}

TEST(Triangulate, MinimisesTheReprojectionError) {
  const StereoCamera camera = kitti_camera();
  const Eigen::Vector3d p_a(2, 0.5, 8);
  const Eigen::Vector2d x_a = camera.project(p_a) + Eigen::Vector2d(0.5, 1.0);
  const Eigen::Vector2d x_b = camera.project(kTAB.inverse() * p_a) + Eigen::Vector2d(-0.3, -1.0);
  const auto point = triangulate(camera, kTAB, x_a, x_b);
  ASSERT_TRUE(point.valid);
  const auto cost = [&](const Eigen::Vector3d& p) {
    return (camera.project(p) - x_a).squaredNorm() +
           (camera.project(kTAB.inverse() * p) - x_b).squaredNorm();
  };
  const double least = cost(point.p_a);
  EXPECT_NEAR(least, point.error_a * point.error_a + point.error_b * point.error_b, 1e-9);
  for (int k = 0; k < 3; ++k) {
    for (const double d : {-1e-3, 1e-3}) {
      EXPECT_GT(cost(point.p_a + d * Eigen::Vector3d::Unit(k)), least);
    }
  }
}

TEST(Triangulate, PointsBehindAreNotValid) {
  const StereoCamera camera = kitti_camera();
  const Rigid3 sideways(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1, 0, 0));
  // Rays that diverge ahead meet behind both cameras: camera b is to the right yet sees it righter.
  const auto point =
      triangulate(camera, sideways, {camera.cx, camera.cy}, {camera.cx + 50, camera.cy});
  EXPECT_FALSE(point.valid);
}

TEST(Triangulate, ParallelRaysAreNotValid) {
  const StereoCamera camera = kitti_camera();
  const Rigid3 sideways(Eigen::Quaterniond::Identity(), Eigen::Vector3d(1, 0, 0));
  const auto point = triangulate(camera, sideways, {700, 200}, {700, 200});
  EXPECT_FALSE(point.valid);
  EXPECT_NEAR(point.cos_parallax, 1, 1e-12);
  EXPECT_FALSE(triangulate(camera, Rigid3(), {700, 200}, {700, 200}).valid);
}

TEST(Triangulate, NonFiniteInputIsNotValid) {
  const StereoCamera camera = kitti_camera();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(triangulate(camera, kTAB, {nan, 1}, {1, 1}).valid);
  Rigid3 bad = kTAB;
  bad.translation.z() = nan;
  EXPECT_FALSE(triangulate(camera, bad, {600, 180}, {610, 180}).valid);
}

TEST(Epipolar, TrueMatchesLieOnTheLine) {
  const StereoCamera camera = kitti_camera();
  const EpipolarGeometry geometry(camera, kTAB.inverse());
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p_a(random.uniform(-6, 6), random.uniform(-2, 2), random.uniform(4, 25));
    const Eigen::Vector2d x_a = camera.project(p_a);
    const Eigen::Vector2d x_b = camera.project(kTAB.inverse() * p_a);
    const Eigen::Vector3d line = geometry.line(x_a);
    EXPECT_NEAR(line.head<2>().norm(), 1, 1e-12);
    EXPECT_LT(geometry.distance(x_a, x_b), 1e-6);
    EXPECT_NEAR(geometry.distance(x_a, x_b + 3 * line.head<2>()), 3, 1e-6);
    EXPECT_LT(EpipolarGeometry::line_distance(line, geometry.epipole()), 1e-6);
  }
}

TEST(Epipolar, RectifiedPairHasItsRows) {
  const StereoCamera camera = kitti_camera();
  const Rigid3 T_b_a(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-0.5, 0, 0));
  const EpipolarGeometry geometry(camera, T_b_a);
  EXPECT_NEAR(geometry.distance({300, 100}, {200, 107.5}), 7.5, 1e-9);
}

TEST(Epipolar, NoTranslationNoLine) {
  const EpipolarGeometry geometry(kitti_camera(), Rigid3());
  EXPECT_TRUE(std::isinf(geometry.distance({300, 100}, {300, 100})));
}

}  // namespace
}  // namespace kys_slam::test
