#include "optimization/ceres_support.h"

#include <algorithm>

namespace kys_slam {

ceres::Solver::Options quiet_solver_options(int threads) {
  ceres::Solver::Options options;
  options.logging_type = ceres::SILENT;
  options.minimizer_progress_to_stdout = false;
  options.num_threads = std::max(1, threads);
  options.max_solver_time_in_seconds = 1e9;
#ifdef KYS_WITH_SUITESPARSE
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
#else
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
#endif
  return options;
}

}  // namespace kys_slam
