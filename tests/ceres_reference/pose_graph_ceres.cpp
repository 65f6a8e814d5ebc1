// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "ceres_reference/ceres_reference.h"
#include "ceres_reference/cost_functions.h"

namespace kys_slam {

void solve_pose_graph_ceres(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                            const std::vector<PoseGraphEdge>& edges, int iterations,
                            double tolerance) {
  std::vector<Eigen::Matrix<double, 6, 1>> increments(T_w_c.size());
  for (auto& increment : increments) increment.setZero();
  ceres::Problem problem;
  for (const PoseGraphEdge& e : edges) {
    const auto a = static_cast<std::size_t>(e.a);
    const auto b = static_cast<std::size_t>(e.b);
    problem.AddResidualBlock(new RelativePoseCost(&T_w_c[a], &T_w_c[b], e.T_a_b, e.weight), nullptr,
                             increments[a].data(), increments[b].data());
  }
  for (std::size_t i = 0; i < fixed.size(); ++i) {
    if (fixed[i] != 0 && problem.HasParameterBlock(increments[i].data())) {
      problem.SetParameterBlockConstant(increments[i].data());
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = iterations;
  options.initial_trust_region_radius = 1e8;  // as little damping as ours begins with
  options.function_tolerance = options.parameter_tolerance = options.gradient_tolerance = tolerance;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t i = 0; i < T_w_c.size(); ++i) T_w_c[i] = plus(T_w_c[i], increments[i]);
}

}  // namespace kys_slam
