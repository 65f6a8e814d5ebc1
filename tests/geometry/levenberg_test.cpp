// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/levenberg.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace kys_slam {
namespace {

using Outcome = LevenbergStep::Outcome;

/// Rosenbrock's valley as least squares: residuals 10 (y - x^2), 1 - x; the minimum is at (1, 1).
struct Valley {
  Eigen::Vector2d at{-1.2, 1}, before = at;
  bool predicts = true;
  std::vector<double> costs{};  // of places that were accepted
  int restored = 0;

  [[nodiscard]] static Eigen::Vector2d residual(const Eigen::Vector2d& p) {
    return {10 * (p.y() - p.x() * p.x()), 1 - p.x()};
  }
  [[nodiscard]] double cost() const { return 0.5 * residual(at).squaredNorm(); }
  LevenbergStep step(double damping) {
    Eigen::Matrix2d J;
    J << -20 * at.x(), 10, -1, 0;
    const Eigen::Vector2d g = J.transpose() * residual(at);
    Eigen::Matrix2d H = J.transpose() * J;
    const Eigen::Vector2d added = damping * H.diagonal();
    H.diagonal() += added;
    const Eigen::Vector2d step = -H.llt().solve(g);
    before = at;
    at += step;
    const double predicted = 0.5 * (step.dot(added.cwiseProduct(step)) - step.dot(g));
    return {Outcome::kTaken, predicts ? predicted : LevenbergStep::kUnknown};
  }
  [[nodiscard]] double cost_of_step() const { return cost(); }
  void accept() { costs.push_back(cost()); }
  void restore() {
    at = before;
    ++restored;
  }
};

TEST(Levenberg, GoesDownTheValley) {
  for (const bool predicts : {true, false}) {
    Valley valley;
    valley.predicts = predicts;
    const LevenbergSummary summary =
        levenberg(valley, Damping(1e-3), {.iterations = 200, .tolerance = 1e-12});
    EXPECT_LT((valley.at - Eigen::Vector2d(1, 1)).norm(), 1e-5) << predicts;
    EXPECT_DOUBLE_EQ(summary.initial_cost, 0.5 * (4.4 * 4.4 + 2.2 * 2.2));
    EXPECT_EQ(summary.final_cost, valley.costs.back());
    EXPECT_LE(summary.iterations, 200);
    for (std::size_t k = 1; k < valley.costs.size(); ++k) {
      EXPECT_LE(valley.costs[k], valley.costs[k - 1]);
    }
    EXPECT_GT(valley.restored, 0) << "the full step leaves the valley";
  }
}

/// Says how every step goes.
struct Script {
  std::vector<LevenbergStep> steps;
  std::vector<double> costs;  // after each
  double at = 10;
  std::vector<double> dampings{};
  std::size_t next = 0;
  int accepted = 0, restored = 0;

  [[nodiscard]] double cost() const { return at; }
  LevenbergStep step(double damping) {
    dampings.push_back(damping);
    return steps.at(next++);
  }
  [[nodiscard]] double cost_of_step() const { return costs.at(next - 1); }
  void accept() { ++accepted; }
  void restore() { ++restored; }
};

TEST(Levenberg, WithoutASolutionTheDampingGrows) {
  Script script{{{Outcome::kNone}, {Outcome::kNone}, {Outcome::kTaken, 1}}, {0, 0, 9.0}};
  const LevenbergSummary summary = levenberg(script, Damping(1), {.iterations = 3});
  EXPECT_EQ(script.dampings, (std::vector<double>{1, 2, 8}));
  EXPECT_EQ(script.restored, 0) << "nothing has moved";
  EXPECT_EQ(script.accepted, 1);
  EXPECT_EQ(summary.final_cost, 9);
  EXPECT_EQ(summary.iterations, 3);
}

TEST(Levenberg, ACostThatIsNoNumberIsRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double predicted : {1.0, LevenbergStep::kUnknown}) {
    Script script{{{Outcome::kTaken, predicted}}, {nan}};
    const LevenbergSummary summary = levenberg(script, Damping(1), {.iterations = 1});
    EXPECT_EQ(script.restored, 1);
    EXPECT_EQ(summary.final_cost, 10);
  }
}

TEST(Levenberg, EndsWhereItIsTold) {
  const LevenbergStep taken{Outcome::kTaken, 1}, last{Outcome::kTaken, 1, true};
  const auto iterations = [](std::vector<LevenbergStep> steps, std::vector<double> costs,
                             bool ends_when_flat = false) {
    Script script{std::move(steps), std::move(costs)};
    const LevenbergOptions options{
        .iterations = 2, .tolerance = 1e-2, .ends_when_flat = ends_when_flat};
    return levenberg(script, Damping(1), options).iterations;
  };
  EXPECT_EQ(iterations({taken, taken}, {9, 8}), 2);
  EXPECT_EQ(iterations({taken, taken}, {9.95, 8}), 1) << "0.5 % less";
  EXPECT_EQ(iterations({last, taken}, {9, 8}), 1);
  EXPECT_EQ(iterations({last, taken}, {11, 8}), 1) << "refused";
  EXPECT_EQ(iterations({taken, taken}, {10.05, 8}), 2);
  EXPECT_EQ(iterations({taken, taken}, {10.05, 8}, true), 1) << "flat";
  EXPECT_EQ(iterations({taken, taken}, {12, 8}, true), 2);
  EXPECT_EQ(iterations({{Outcome::kTaken, 1e-5}, taken}, {9, 8}), 1) << "next to nothing predicted";
}

TEST(Levenberg, AnInterruptEndsIt) {
  std::atomic<bool> stop{true};
  Script script{{{Outcome::kStopped}}, {0}};
  LevenbergSummary summary = levenberg(script, Damping(1), {.iterations = 5, .stop = &stop});
  EXPECT_TRUE(summary.stopped);
  EXPECT_EQ(summary.iterations, 0);
  stop = false;
  summary = levenberg(script, Damping(1), {.iterations = 5, .stop = &stop});
  EXPECT_TRUE(summary.stopped) << "in the middle of a step";
  EXPECT_EQ(summary.final_cost, 10);
  EXPECT_EQ(script.accepted + script.restored, 0);
}

}  // namespace
}  // namespace kys_slam
