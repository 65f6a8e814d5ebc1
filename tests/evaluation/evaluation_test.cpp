// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/evaluation.h>

#include <cmath>

namespace kys_slam {
namespace {

std::vector<TimedPose> line(int count, double spacing) {
  std::vector<TimedPose> poses;
  for (int i = 0; i < count; ++i) {
    poses.push_back({0.1 * i, Rigid3(Eigen::Quaterniond::Identity(), {0, 0, spacing * i})});
  }
  return poses;
}

std::vector<TimedPose> helix(int count) {
  std::vector<TimedPose> poses;
  for (int i = 0; i < count; ++i) {
    const double a = 0.1 * i;
    poses.push_back(
        {0.1 * i, Rigid3(so3_exp({0, a, 0}), {5 * std::sin(a), 0.2 * a, 5 * std::cos(a)})});
  }
  return poses;
}

TEST(Statistics, WorkedByHand) {
  const std::vector<double> errors = {4, 1, 2, 1};
  const Statistics s = statistics(errors);
  EXPECT_EQ(s.count, 4u);
  EXPECT_DOUBLE_EQ(s.mean, 2);
  EXPECT_DOUBLE_EQ(s.median, 1.5);
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(22.0 / 4));
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(1.5));
  EXPECT_DOUBLE_EQ(s.min, 1);
  EXPECT_DOUBLE_EQ(s.max, 4);
  EXPECT_EQ(statistics({}).count, 0u);
}

TEST(Alignment, UndoesAKnownSimilarity) {
  const auto reference = helix(50);
  Similarity moved;
  moved.scale = 0.5;
  moved.T = Rigid3(so3_exp({0.3, -1.2, 0.4}), {1, 2, 3});
  TrajectoryPair pair{reference, reference};
  transform(pair.estimate, moved);
  const Similarity back = align(pair, Alignment::kSim3);
  EXPECT_NEAR(back.scale, 2.0, 1e-12);
  EXPECT_FALSE(back.degenerate);
  transform(pair.estimate, back);
  for (std::size_t i = 0; i < pair.size(); ++i) {
    EXPECT_LT(minus(pair.estimate[i].T_w_c, pair.reference[i].T_w_c).norm(), 1e-10);
  }
}

TEST(Alignment, NeverMirrors) {
  // A planar estimate fits its mirror image as well as itself; the result must be a rotation.
  TrajectoryPair pair{helix(30), helix(30)};
  for (auto& pose : pair.reference) pose.T_w_c.translation.y() = 0;
  for (auto& pose : pair.estimate) pose.T_w_c.translation.x() *= -1;
  EXPECT_NEAR(align(pair, Alignment::kSe3).T.R().determinant(), 1.0, 1e-12);
}

TEST(Alignment, StraightLineTakesTheRotationOfTheFirstPose) {
  TrajectoryPair pair{line(20, 1), line(20, 1)};
  const Rigid3 moved(so3_exp({0, 0.5, 0.2}), Eigen::Vector3d(3, 2, 1));
  for (auto& pose : pair.estimate) pose.T_w_c = moved * pose.T_w_c;
  const Similarity similarity = align(pair, Alignment::kSe3);
  EXPECT_TRUE(similarity.degenerate);
  transform(pair.estimate, similarity);
  EXPECT_LT(statistics(absolute_errors(pair)).max, 1e-12);
  // Standing still, and next to nothing.
  TrajectoryPair still{line(5, 0), line(5, 0)};
  EXPECT_TRUE(align(still, Alignment::kSim3).degenerate);
  EXPECT_DOUBLE_EQ(align(still, Alignment::kSim3).scale, 1);
  EXPECT_EQ(evaluate({}, {}).pairs, 0u);
  EXPECT_EQ(evaluate(still.reference, {}).pairs, 0u);
}

TEST(Association, NearestWithinTheLimit) {
  const auto reference = line(11, 1);  // every 0.1 s
  std::vector<TimedPose> estimate = {{0.004, {}}, {0.149, {}}, {0.206, {}}, {1.011, {}}};
  const TrajectoryPair pair = associate_by_time(reference, estimate, 0.01);
  ASSERT_EQ(pair.size(), 2u);
  EXPECT_DOUBLE_EQ(pair.reference[1].timestamp, 0.2);
  EXPECT_DOUBLE_EQ(pair.estimate[1].timestamp, 0.206);
  EXPECT_EQ(associate_by_time(estimate, reference, 0.0601).size(), 4u);
}

TEST(RelativeErrors, OfAConstantDrift) {
  TrajectoryPair pair{line(21, 1.0), line(21, 1.01)};
  for (int i = 0; i < 21; ++i) pair.estimate[i].T_w_c.rotation = so3_exp({0, 0, 0.002 * i});
  const RelativeErrors one = relative_errors(pair, 1);
  ASSERT_EQ(one.translation.size(), 20u);
  EXPECT_NEAR(statistics(one.translation).max, 0.01, 1e-12);
  EXPECT_NEAR(statistics(one.rotation).min, 0.002 * 180 / M_PI, 1e-9);
  EXPECT_EQ(relative_errors(pair, 6).translation.size(), 3u);
  EXPECT_EQ(relative_errors(pair, 6, true).translation.size(), 15u);
  EXPECT_EQ(relative_errors(pair, 21).translation.size(), 0u);
}

TEST(KittiErrors, OfAOnePercentScaleError) {
  const TrajectoryPair pair{line(1001, 1.0), line(1001, 1.01)};
  const KittiErrors errors = kitti_errors(pair);
  // Segments of L metres end at the first frame beyond L: L + 1 frames of error 0.01 m.
  double sum = 0;
  std::size_t count = 0;
  for (int first = 0; first <= 1000; first += 10) {
    for (int length = 100; length <= 800 && first + length + 1 <= 1000; length += 100, ++count) {
      sum += 0.01 * (length + 1) / length * 100;
    }
  }
  EXPECT_EQ(errors.segments, count);
  EXPECT_NEAR(errors.translation_percent, sum / static_cast<double>(count), 1e-9);
  EXPECT_NEAR(errors.rotation_deg_per_100m, 0, 1e-12);
  EXPECT_EQ(kitti_errors({line(50, 1), line(50, 1)}).segments, 0u);
  EXPECT_DOUBLE_EQ(path_length(pair.reference), 1000);
}

}  // namespace
}  // namespace kys_slam
