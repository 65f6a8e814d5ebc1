#include "optimization/pose_graph.h"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>

#include "optimization/ceres_support.h"
#include "optimization/cost_functions.h"

namespace kys_slam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

void check(const std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
           const std::vector<PoseGraphEdge>& edges) {
  if (fixed.size() != T_w_c.size()) {
    throw std::invalid_argument("optimize_pose_graph: fixed and T_w_c differ in length");
  }
  if (!T_w_c.empty() &&
      std::count(fixed.begin(), fixed.end(), 0) == static_cast<std::ptrdiff_t>(fixed.size())) {
    throw std::invalid_argument("optimize_pose_graph: at least one pose has to be fixed");
  }
  const auto poses = static_cast<std::int64_t>(T_w_c.size());
  for (const PoseGraphEdge& edge : edges) {
    if (edge.a < 0 || edge.a >= poses || edge.b < 0 || edge.b >= poses || edge.a == edge.b) {
      throw std::invalid_argument("optimize_pose_graph: edge between poses out of range");
    }
  }
}

/// Edges that say nothing usable are left out rather than poison the rest.
bool is_usable(const PoseGraphEdge& edge, const std::vector<Rigid3>& T_w_c) {
  return edge.T_a_b.is_finite() && std::isfinite(edge.weight) && edge.weight > 0 &&
         T_w_c[edge.a].is_finite() && T_w_c[edge.b].is_finite();
}

}  // namespace

void optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                         const std::vector<PoseGraphEdge>& edges, const PoseGraphOptions& options) {
  check(T_w_c, fixed, edges);
  std::vector<Vector6d> increments(T_w_c.size(), Vector6d::Zero());
  std::deque<RelativePoseCost> costs;  // Ceres keeps pointers to them

  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem problem(problem_options);
  for (const PoseGraphEdge& edge : edges) {
    if (!is_usable(edge, T_w_c) || (fixed[edge.a] != 0 && fixed[edge.b] != 0)) continue;
    costs.emplace_back(&T_w_c[edge.a], &T_w_c[edge.b], edge.T_a_b, edge.weight);
    problem.AddResidualBlock(&costs.back(), nullptr, increments[edge.a].data(),
                             increments[edge.b].data());
  }
  if (costs.empty()) return;
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    if (fixed[i] != 0 && problem.HasParameterBlock(increments[i].data())) {
      problem.SetParameterBlockConstant(increments[i].data());
    }
  }

  StopCallback stop(options.stop);
  ceres::Solver::Options solver = quiet_solver_options(1);
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.function_tolerance = 1e-9;
  solver.max_num_iterations = options.iterations;
  solver.callbacks.push_back(&stop);
  ceres::Solver::Summary report;
  ceres::Solve(solver, &problem, &report);
  if (!report.IsSolutionUsable()) return;
  for (std::size_t i = 0; i < T_w_c.size(); ++i) {
    if (fixed[i] == 0) T_w_c[i] = plus(T_w_c[i], increments[i]);
  }
}

}  // namespace kys_slam
