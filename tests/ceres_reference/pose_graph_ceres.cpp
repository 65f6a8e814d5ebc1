// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "ceres_reference/ceres_reference.h"
#include "ceres_reference/cost_functions.h"

namespace kys_slam {

void solve_pose_graph_ceres(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                            const std::vector<PoseGraphEdge>& edges, int iterations,
                            double tolerance) {
  std::vector<PoseBlock> poses;
  for (const Rigid3& T : T_w_c) poses.push_back(to_block(T));
  PoseManifold manifold;
  ceres::Problem::Options ours;
  ours.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ours);
  for (const PoseGraphEdge& e : edges) {
    const auto a = static_cast<std::size_t>(e.a);
    const auto b = static_cast<std::size_t>(e.b);
    problem.AddResidualBlock(new RelativePoseCost(e.T_a_b, e.weight), nullptr, poses[a].data(),
                             poses[b].data());
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!problem.HasParameterBlock(poses[i].data())) continue;
    problem.SetManifold(poses[i].data(), &manifold);
    if (fixed[i] != 0) problem.SetParameterBlockConstant(poses[i].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = iterations;
  options.initial_trust_region_radius = 1e8;  // as little damping as ours begins with
  options.function_tolerance = options.parameter_tolerance = options.gradient_tolerance = tolerance;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t i = 0; i < T_w_c.size(); ++i) T_w_c[i] = to_pose(poses[i].data());
}

}  // namespace kys_slam
