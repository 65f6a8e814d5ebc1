// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_graph.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "ceres_reference/ceres_reference.h"
#include "synthetic_scene.h"

namespace kys_slam::test {
namespace {

struct Loop {
  std::vector<Rigid3> truth;
  std::vector<Rigid3> drifted;
  std::vector<std::uint8_t> fixed;
  std::vector<PoseGraphEdge> edges;
};

/// Once around a circle of 50 m, odometry with a bias of heading; the last edge closes the loop.
Loop make_loop(int count, double bias_rad) {
  Loop loop;
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * M_PI * i / count;
    loop.truth.emplace_back(so3_exp({0, angle, 0}),
                            Eigen::Vector3d(-50 * std::cos(angle), 0, 50 * std::sin(angle)));
  }
  loop.drifted.push_back(loop.truth[0]);
  loop.fixed.assign(static_cast<std::size_t>(count), 0);
  loop.fixed[0] = 1;
  const Rigid3 bias(so3_exp({0, bias_rad, 0}), Eigen::Vector3d(0, 0, 0.01));
  for (int i = 0; i + 1 < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Rigid3 T_a_b = loop.truth[k].inverse() * loop.truth[k + 1] * bias;
    loop.drifted.push_back(loop.drifted[k] * T_a_b);
    loop.edges.push_back({i, i + 1, T_a_b, 1});
  }
  loop.edges.push_back({count - 1, 0, loop.truth.back().inverse() * loop.truth[0], 1});
  return loop;
}

double end_gap(const Loop& loop, const std::vector<Rigid3>& poses) {
  const PoseGraphEdge& closing = loop.edges.back();
  return minus(poses[static_cast<std::size_t>(closing.a)] * closing.T_a_b, poses[0]).norm();
}

TEST(PoseGraph, ClosesALoopWithDrift) {
  const Loop loop = make_loop(200, 0.001);
  std::vector<Rigid3> poses = loop.drifted;
  const double gap_before = end_gap(loop, poses);
  ASSERT_GT(gap_before, 5);
  PoseGraphOptions options;
  options.iterations = 50;
  optimize_pose_graph(poses, loop.fixed, loop.edges, options);
  EXPECT_LT(end_gap(loop, poses), gap_before / 50);
  double before = 0;
  double after = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    before += (loop.drifted[i].t() - loop.truth[i].t()).squaredNorm();
    after += (poses[i].t() - loop.truth[i].t()).squaredNorm();
  }
  EXPECT_LT(after, before / 25);
  EXPECT_EQ(poses[0].t(), loop.truth[0].t());  // fixed
}

TEST(PoseGraph, ConsistentEdgesAreMetExactly) {
  Loop loop = make_loop(60, 0);
  for (auto& e : loop.edges) {
    e.T_a_b = loop.truth[static_cast<std::size_t>(e.a)].inverse() *
              loop.truth[static_cast<std::size_t>(e.b)];
  }
  Random random(1);
  std::vector<Rigid3> poses = loop.truth;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    poses[i] = plus(poses[i], random.increment(0.1, 1.0));
  }
  PoseGraphOptions options;
  options.iterations = 100;
  optimize_pose_graph(poses, loop.fixed, loop.edges, options);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_LT(minus(poses[i], loop.truth[i]).norm(), 1e-3) << i;
  }
}

TEST(PoseGraph, HeavierEdgesGiveLess) {
  const std::vector<Rigid3> start(3);
  const Eigen::Quaterniond identity = Eigen::Quaterniond::Identity();
  std::vector<Rigid3> poses = start;
  // Two claims about pose 1: 0 m by an edge of weight 1, 1 m by one of weight 2 (4 times the say).
  optimize_pose_graph(
      poses, {1, 0, 1},
      {{0, 1, Rigid3(identity, {0, 0, 0}), 1}, {2, 1, Rigid3(identity, {0, 0, 1}), 2}});
  EXPECT_NEAR(poses[1].t().z(), 0.8, 1e-6);
}

TEST(PoseGraph, UnusableEdgesAreLeftOut) {
  Loop loop = make_loop(40, 0.002);
  std::vector<Rigid3> expected = loop.drifted;
  optimize_pose_graph(expected, loop.fixed, loop.edges);
  PoseGraphEdge bad{3, 17, Rigid3(), 1};
  bad.T_a_b.translation.x() = std::numeric_limits<double>::quiet_NaN();
  loop.edges.push_back(bad);
  loop.edges.push_back({4, 5, Rigid3(), std::numeric_limits<double>::infinity()});
  std::vector<Rigid3> poses = loop.drifted;
  optimize_pose_graph(poses, loop.fixed, loop.edges);
  for (std::size_t i = 0; i < poses.size(); ++i) EXPECT_EQ(poses[i].t(), expected[i].t());
}

TEST(PoseGraph, ReachesTheMinimumOfTheReference) {
  Loop loop = make_loop(150, 0.001);
  Random random(4);
  for (auto& edge : loop.edges) edge.T_a_b = plus(edge.T_a_b, random.increment(0.002, 0.02));
  for (int i = 0; i + 7 < 150; ++i) {  // covisible ones, of all weights, also against the order
    const auto a = static_cast<std::size_t>(i);
    const Rigid3 T_b_a = loop.truth[a + 7].inverse() * loop.truth[a];
    loop.edges.push_back(
        {i + 7, i, plus(T_b_a, random.increment(0.002, 0.02)), random.uniform(0.5, 2)});
  }
  std::vector<Rigid3> poses = loop.drifted;
  PoseGraphOptions options;
  options.iterations = 100;
  optimize_pose_graph(poses, loop.fixed, loop.edges, options);
  std::vector<Rigid3> reference = loop.drifted;
  solve_pose_graph_ceres(reference, loop.fixed, loop.edges, 300, 1e-15);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_LT(minus(poses[i], reference[i]).norm(), 1e-5) << i;
  }
}

TEST(PoseGraph, SameInputSameBytes) {
  const Loop loop = make_loop(200, 0.001);
  std::vector<Rigid3> first = loop.drifted;
  std::vector<Rigid3> second = loop.drifted;
  optimize_pose_graph(first, loop.fixed, loop.edges);
  optimize_pose_graph(second, loop.fixed, loop.edges);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].t(), second[i].t());
    EXPECT_EQ(first[i].rotation.coeffs(), second[i].rotation.coeffs());
  }
}

TEST(PoseGraph, EmptyAndUnconnected) {
  std::vector<Rigid3> none;
  optimize_pose_graph(none, {}, {});
  std::vector<Rigid3> two(2);
  two[1].translation.x() = 4;
  optimize_pose_graph(two, {1, 0}, {});
  EXPECT_EQ(two[1].t().x(), 4);
}

TEST(PoseGraph, StopFlagLeavesValidPoses) {
  const Loop loop = make_loop(100, 0.001);
  std::vector<Rigid3> poses = loop.drifted;
  const std::atomic<bool> stop{true};
  PoseGraphOptions options;
  options.stop = &stop;
  optimize_pose_graph(poses, loop.fixed, loop.edges, options);
  for (const Rigid3& T : poses) EXPECT_TRUE(T.is_finite());
}

TEST(PoseGraph, WrongArgumentsAreRefused) {
  std::vector<Rigid3> poses(2);
  EXPECT_THROW(optimize_pose_graph(poses, {0, 0}, {}), std::invalid_argument);
  EXPECT_THROW(optimize_pose_graph(poses, {1}, {}), std::invalid_argument);
  EXPECT_THROW(optimize_pose_graph(poses, {1, 0}, {{0, 2, Rigid3(), 1}}), std::invalid_argument);
}

}  // namespace
}  // namespace kys_slam::test
