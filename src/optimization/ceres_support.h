#pragma once

#include <ceres/iteration_callback.h>
#include <ceres/solver.h>

#include <atomic>

namespace kys_slam {

/// Ends the solution after the iteration during which `stop` was set; keeps what was reached.
class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const std::atomic<bool>* stop) : stop_(stop) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    if (stop_ == nullptr || !stop_->load(std::memory_order_relaxed)) {
      return ceres::SOLVER_CONTINUE;
    }
    was_stopped_ = true;
    return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }
  [[nodiscard]] bool was_stopped() const { return was_stopped_; }

 private:
  const std::atomic<bool>* stop_;
  bool was_stopped_ = false;
};

/// Options common to all problems: nothing printed, no limit of time, the sparse library chosen
/// when the project was configured.
ceres::Solver::Options quiet_solver_options(int threads);

}  // namespace kys_slam
