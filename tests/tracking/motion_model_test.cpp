// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/motion_model.h"

#include <gtest/gtest.h>

namespace kys_slam {
namespace {

using Link = MotionModel::Link;

/// T_c_w of a camera `x` m along the first axis of the world.
Rigid3 at(double x) {
  return Rigid3(Eigen::Quaterniond::Identity(), {-x, 0, 0});
}

/// A camera of 10 Hz that goes 1 m per frame.
MotionModel moving(int frames, Link last = Link::kTracked) {
  MotionModel model{MotionModelOptions{}};
  for (int i = 0; i < frames; ++i) {
    const double taken = model.time_of(i, 0.1 * i, false);
    model.add(i, taken, at(i), i == 0 ? Link::kStarted : i + 1 == frames ? last : Link::kTracked);
  }
  return model;
}

TEST(MotionModel, ExpectsTheLastVelocityToGoOn) {
  const MotionModel model = moving(5);
  const auto next = model.expected(0.5);
  ASSERT_TRUE(next);
  EXPECT_LT((next->T_c_w.inverse_t() - Eigen::Vector3d(5, 0, 0)).norm(), 1e-9);
  EXPECT_NEAR(next->reach, 0.01, 1e-9) << "interval^2, s^2";
  const auto prior = model.prior(0.5);
  ASSERT_TRUE(prior);
  EXPECT_NEAR(prior->sigma_position, 3 * 0.01, 1e-9) << "m/s^2 times s^2";
}

TEST(MotionModel, ExpectsNothingBeforeTwoFramesOrLongAfterThem) {
  EXPECT_FALSE(moving(1).expected(0.1));
  EXPECT_TRUE(moving(5).expected(0.4 + 0.5));
  EXPECT_FALSE(moving(5).expected(0.4 + 0.6));
}

/// 15 m/s^2 over 0.1 s lead 0.15 m away from the expected position.
TEST(MotionModel, KnowsWhichMotionsAreImpossible) {
  const MotionModel model = moving(5);
  EXPECT_FALSE(model.is_impossible(at(5.14), 0.5));
  EXPECT_TRUE(model.is_impossible(at(5.16), 0.5));
  EXPECT_TRUE(model.is_impossible(at(4.84), 0.5));
  EXPECT_FALSE(model.is_impossible(at(4.0), 0.5, 1)) << "within one step of 1 m";
  EXPECT_TRUE(model.is_impossible(at(3.8), 0.5, 1));
  EXPECT_FALSE(moving(1).is_impossible(at(9), 0.1)) << "nothing is known";
  EXPECT_TRUE(model.is_near(at(5.1), 0.5, 11));
  EXPECT_FALSE(model.is_near(at(5.1), 0.5, 9));
}

TEST(MotionModel, ARelocalisedFrameHasNoVelocityAStartedOneKeepsIt) {
  EXPECT_FALSE(moving(5, Link::kRelocalised).expected(0.5));
  MotionModel model = moving(5);
  model.add(5, model.time_of(5, 0.5, false), Rigid3(), Link::kStarted);
  const auto next = model.expected(0.6);
  ASSERT_TRUE(next);
  EXPECT_LT((next->T_c_w.inverse_t() - Eigen::Vector3d(1, 0, 0)).norm(), 1e-9)
      << "one step from the origin of the new world";
  model.forget_velocity();
  EXPECT_FALSE(model.expected(0.6));
}

TEST(MotionModel, StepsCountMissingImages) {
  MotionModel model = moving(5);
  EXPECT_EQ(model.steps_since(5, model.time_of(5, 0.5, false)), 1);
  EXPECT_EQ(model.steps_since(5, model.time_of(6, 0.6, false)), 2) << "by the time";
  EXPECT_EQ(model.steps_since(20, 0.7), 3) << "the most";
}

TEST(MotionModel, FollowsAPoseThatTheMapMoves) {
  MotionModel model = moving(5);
  model.move_last(at(40));
  EXPECT_LT((model.expected(0.5)->T_c_w.inverse_t() - Eigen::Vector3d(41, 0, 0)).norm(), 1e-9);
}

}  // namespace
}  // namespace kys_slam
