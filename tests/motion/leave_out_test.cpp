// SPDX-License-Identifier: BSD-3-Clause
#include "motion/leave_out.h"

#include <gtest/gtest.h>

#include <random>

#include "map/frame_features.h"

namespace kys_slam {
namespace {

const StereoCamera kRig{1241, 376, 720, 720, 610, 185, 0.54};

PoseTerm term(const Rigid3& T_c_w, const Eigen::Vector3d& p_w, std::int32_t instance) {
  const Eigen::Vector3d pixel = kRig.project_stereo(T_c_w * p_w);
  return {p_w,
          {static_cast<float>(pixel.x()), static_cast<float>(pixel.y()),
           static_cast<float>(pixel.z()), 1 / kPixelSigma},
          1,
          instance};
}

/// A scene at rest, and a thing that was 0.2 m elsewhere when its landmarks were made.
TEST(PoseWithout, IsThePoseOfTheOthers) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> side(-1, 1);
  const Rigid3 truth{so3_exp({0.01, -0.02, 0.005}), {0.3, -0.1, 0.5}};
  std::vector<PoseTerm> terms;
  for (int i = 0; i < 200; ++i) {
    terms.push_back(term(truth, {8 * side(random), 2 * side(random), 15 + 6 * side(random)}, -1));
  }
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d p_w(side(random), side(random), 10 + side(random));
    terms.push_back(term(truth, p_w + Eigen::Vector3d(0.2, 0, 0.1), 7));
    terms.back().p_w = p_w;
  }
  // The pose that all of them agree on: Gauss-Newton by the sums themselves.
  Rigid3 T_c_w = truth;
  for (int i = 0; i < 20; ++i) {
    std::vector<PoseTerm> all = terms;
    for (PoseTerm& t : all) t.instance = -1;
    PoseTerm nothing = all.front();
    nothing.weight = 0;
    nothing.instance = 1;
    all.push_back(nothing);  // without it, which is all of them
    T_c_w = PoseWithout(kRig, T_c_w, all).without(1).applied_to(T_c_w);
  }
  EXPECT_GT(minus(T_c_w, truth).tail<3>().norm(), 0.02);  // pulled along

  const PoseWithout pose(kRig, T_c_w, terms);
  const Rigid3 without = pose.without(7).applied_to(T_c_w);
  EXPECT_LT(minus(without, truth).tail<3>().norm(), 0.004);
  EXPECT_LT(minus(without, truth).head<3>().norm(), 4e-4);
  EXPECT_EQ(pose.without(5).delta.norm(), 0);  // no such thing
  EXPECT_LT(pose.without(5).covariance(5, 5), pose.without(7).covariance(5, 5));
}

TEST(PoseWithout, NothingLeftIsUnknown) {
  std::vector<PoseTerm> terms;
  for (int i = 0; i < 20; ++i) terms.push_back(term({}, {0.1 * i, 0.05 * i, 10.0 + 0.2 * i}, 7));
  EXPECT_GT(PoseWithout(kRig, {}, terms).without(7).covariance(5, 5), 1);
}

/// The covariance of a motion between two frames against sampled poses.
TEST(CameraMotion, CovarianceIsThatOfBothPoses) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  const Rigid3 T_before{so3_exp({0.1, 0.2, -0.1}), {1, 2, 3}};
  const Rigid3 T_now{so3_exp({0.12, 0.3, -0.1}), {1.5, 2, 2}};
  PoseIncrement before;
  PoseIncrement now;
  before.covariance.diagonal() << 1e-6, 2e-6, 3e-6, 1e-4, 2e-4, 3e-4;
  now.covariance.diagonal() << 2e-6, 1e-6, 1e-6, 3e-4, 1e-4, 1e-4;
  const CameraMotion motion = camera_motion(T_before, before, T_now, now);
  Matrix6d sampled = Matrix6d::Zero();
  constexpr int kSamples = 20000;
  for (int k = 0; k < kSamples; ++k) {
    PoseIncrement b;
    PoseIncrement n;
    for (int i = 0; i < 6; ++i) {
      b.delta[i] = std::sqrt(before.covariance(i, i)) * normal(random);
      n.delta[i] = std::sqrt(now.covariance(i, i)) * normal(random);
    }
    const Rigid3 T = camera_motion(T_before, b, T_now, n).T_now_before;
    const Rigid3 change = T * motion.T_now_before.inverse();
    Vector6d delta;
    delta << so3_log(change.rotation), change.translation;
    sampled += delta * delta.transpose() / kSamples;
  }
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(sampled(i, i) / motion.covariance(i, i), 1, 0.05) << i;
  }
}

}  // namespace
}  // namespace kys_slam
