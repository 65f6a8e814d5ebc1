// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "optimization/bundle_solver.h"
#include "optimization/pose_graph.h"

/// Our problems solved by Ceres: what tests and benchmarks compare our own solvers with.
namespace kys_slam {

/// For BundleOptions::round_solver: DENSE_SCHUR for few free poses, SPARSE_SCHUR for many.
/// \throws std::invalid_argument for a disparity_weight other than 1
BundleRoundSummary solve_bundle_ceres(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round);

/// optimize_pose_graph by SPARSE_NORMAL_CHOLESKY.
/// \param tolerance share of the cost below which a step ends it
void solve_pose_graph_ceres(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                            const std::vector<PoseGraphEdge>& edges, int iterations,
                            double tolerance = 1e-9);

}  // namespace kys_slam
