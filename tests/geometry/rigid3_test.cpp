// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/rigid3.h>

#include "geometry/so3.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

TEST(StereoCamera, BackProjectionUndoesProjection) {
  const StereoCamera camera = kitti_camera();
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p(random.uniform(-20, 20), random.uniform(-5, 5), random.uniform(1, 80));
    const Eigen::Vector3d uvr = camera.project_stereo(p);
    const double depth = camera.bf() / (uvr.x() - uvr.z());
    EXPECT_LT((camera.back_project(uvr.x(), uvr.y(), depth) - p).norm(), 1e-9);
    EXPECT_EQ(camera.project(p), Eigen::Vector2d(uvr.head<2>()));
  }
}

TEST(StereoCamera, HandWorkedProjection) {
  StereoCamera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = 500;
  camera.fy = 400;
  camera.cx = 320;
  camera.cy = 240;
  camera.baseline = 0.2;
  const Eigen::Vector3d uvr = camera.project_stereo({1, -0.5, 4});
  EXPECT_DOUBLE_EQ(uvr.x(), 445);  // 500/4 + 320
  EXPECT_DOUBLE_EQ(uvr.y(), 190);  // -0.5*400/4 + 240
  EXPECT_DOUBLE_EQ(uvr.z(), 420);  // disparity 500*0.2/4 = 25
}

TEST(Rigid3, GroupLaws) {
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Rigid3 T_a_b = plus(Rigid3(), random.increment(2, 5));
    const Rigid3 T_b_c = plus(Rigid3(), random.increment(2, 5));
    const Eigen::Vector3d p_c = random.vector(10);
    EXPECT_LT((T_a_b * T_b_c * p_c - T_a_b * (T_b_c * p_c)).norm(), 1e-12 * 100);
    EXPECT_LT((T_a_b.inverse() * (T_a_b * p_c) - p_c).norm(), 1e-12 * 100);
  }
}

TEST(Rigid3, MinusUndoesPlus) {
  Random random(3);
  for (const double size : {1e-12, 1e-7, 1e-3, 0.5}) {
    const Rigid3 T = plus(Rigid3(), random.increment(1, 5));
    const auto d = random.increment(size, size);
    EXPECT_LT((minus(plus(T, d), T) - d).norm(), 1e-9 * size + 1e-14 * 10) << size;
  }
}

TEST(So3, LogUndoesExpUpToPi) {
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-5, 0.1, 1.0, 3.0, 3.14159}) {
    const Eigen::Vector3d w = angle * Eigen::Vector3d(0.6, -0.48, 0.64);
    EXPECT_LT((so3_log(so3_exp(w)) - w).norm(), 1e-12) << angle;
  }
}

TEST(So3, LeftJacobianMatchesNumericDifferences) {
  Random random(4);
  for (const double size : {0.0, 1e-6, 0.9e-4, 1.1e-4, 1e-3, 0.1, 1.5}) {
    const Eigen::Vector3d w = size * random.vector(1).normalized();
    const Eigen::Matrix3d J = so3_left_jacobian(w);
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d d = 1e-6 * Eigen::Vector3d::Unit(k);
      const Eigen::Vector3d numeric = so3_log(so3_exp(w + d) * so3_exp(w - d).conjugate()) / 2e-6;
      EXPECT_LT((J.col(k) - numeric).norm(), 1e-8) << size;
    }
    const Eigen::Matrix3d product = J * so3_left_jacobian_inverse(w);
    EXPECT_LT((product - Eigen::Matrix3d::Identity()).norm(), 1e-11) << size;
  }
}

}  // namespace
}  // namespace kys_slam::test
