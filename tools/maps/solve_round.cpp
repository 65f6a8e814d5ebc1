// SPDX-License-Identifier: BSD-3-Clause
#include "solve_round.h"

#include <ceres/iteration_callback.h>
#include <ceres/solver.h>

#include <algorithm>

namespace kys_slam {

namespace {

class IterationWatch final : public ceres::IterationCallback {
 public:
  IterationWatch(const Watch& watch, const SolveRound& round, int done)
      : watch_(watch), round_(round), done_(done) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (watch_.progress) watch_.progress(done_ + summary.iteration, round_.most, round_.what);
    const bool stop = watch_.stop != nullptr && watch_.stop->load(std::memory_order_relaxed);
    return stop ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  const Watch& watch_;
  const SolveRound& round_;
  int done_;
};

}  // namespace

bool solve_round(ceres::Problem& problem,
                 const std::shared_ptr<ceres::ParameterBlockOrdering>& ordering,
                 const SolveRound& round, const Watch& watch, int& done) {
  IterationWatch callback(watch, round, done);
  ceres::Solver::Options solver;
  solver.logging_type = ceres::SILENT;
  solver.num_threads = 1;
  solver.linear_solver_type = ceres::SPARSE_SCHUR;
  solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  solver.linear_solver_ordering = ordering;
  solver.max_num_iterations = round.iterations;
  solver.max_solver_time_in_seconds = 1e9;
  solver.function_tolerance = round.function_tolerance;
  solver.parameter_tolerance = 1e-13;  // of the norm of all points: the default ends too early
  solver.callbacks.push_back(&callback);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  done += std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  return summary.termination_type != ceres::USER_SUCCESS;
}

}  // namespace kys_slam
