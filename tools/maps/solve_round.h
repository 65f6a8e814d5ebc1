// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include <atomic>
#include <functional>
#include <memory>
#include <string>

namespace kys_slam {

/// How far an adjustment is, and whether it is to end.
struct Watch {
  const std::atomic<bool>* stop = nullptr;  ///< ends it early, with the best so far
  /// Called after every iteration: how many are done of at most how many, and what is done.
  std::function<void(int, int, const std::string&)> progress;
};

struct SolveRound {
  std::string what;
  int iterations = 10;
  int most = 0;  ///< of all rounds together
  double function_tolerance = 1e-6;
};

/// SPARSE_SCHUR with SuiteSparse, one thread: the same bytes every time. \param done iterations of
/// all rounds, increased \return false when it was stopped
bool solve_round(ceres::Problem& problem,
                 const std::shared_ptr<ceres::ParameterBlockOrdering>& ordering,
                 const SolveRound& round, const Watch& watch, int& done);

}  // namespace kys_slam
