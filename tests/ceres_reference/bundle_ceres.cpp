// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <memory>
#include <stdexcept>

#include "ceres_reference/ceres_reference.h"
#include "ceres_reference/cost_functions.h"

namespace kys_slam {
namespace {

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

/// More free poses than this make a reduced system that is worth treating as sparse.
constexpr int kDenseSchurMaxPoses = 60;

class CeresBundle {
 public:
  CeresBundle(BundleProblem& bundle, const BundleOptions& options, const BundleRound& round)
      : bundle_(bundle),
        loss_stereo_(std::sqrt(options.chi2_stereo)),
        loss_mono_(std::sqrt(options.chi2_mono)),
        pose_used_(bundle.T_c_w.size(), 0),
        point_used_(bundle.points.size(), 0),
        problem_(problem_options()) {
    for (const Rigid3& T_c_w : bundle.T_c_w) poses_.push_back(to_block(T_c_w));
    for (std::size_t point = 0; point < bundle.points.size(); ++point) {
      for (auto i = bundle.first[point]; i < bundle.first[point + 1]; ++i) {
        const auto k = static_cast<std::size_t>(i);
        if (round.active[k] != 0) add(point, bundle.observations[k], round.robust);
      }
    }
    for (const MotionTerm& motion : bundle.motions) {
      problem_.AddResidualBlock(&motion_costs_.emplace_back(motion), nullptr,
                                poses_[motion.a].data(), poses_[motion.b].data());
      pose_used_[motion.a] = pose_used_[motion.b] = 1;
    }
    for (std::size_t i = 0; i < pose_used_.size(); ++i) {
      if (pose_used_[i] == 0) continue;
      problem_.SetManifold(poses_[i].data(), &manifold_);
      if (round.pose_fixed[i] != 0) {
        problem_.SetParameterBlockConstant(poses_[i].data());
      } else {
        ++free_poses_;
      }
    }
  }

  BundleRoundSummary solve(const BundleOptions& options, int iterations) {
    BundleRoundSummary summary;
    if (problem_.NumResidualBlocks() == 0) return summary;
    StopCallback stop(options.stop);
    ceres::Solver::Options solver;
    solver.logging_type = ceres::SILENT;
    solver.max_solver_time_in_seconds = 1e9;
    solver.linear_solver_type =
        free_poses_ <= kDenseSchurMaxPoses ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
    solver.linear_solver_ordering = points_first();
    solver.max_num_iterations = iterations;
    solver.function_tolerance = options.function_tolerance;
    solver.parameter_tolerance = 1e-13;  // of the norm of all points: the default ends too early
    solver.gradient_tolerance = 1e-13;
    solver.callbacks.push_back(&stop);
    ceres::Solver::Summary report;
    ceres::Solve(solver, &problem_, &report);

    summary.initial_cost = report.initial_cost;
    summary.final_cost = report.final_cost;
    summary.iterations = std::max(0, static_cast<int>(report.iterations.size()) - 1);
    summary.stopped = stop.was_stopped();
    if (report.IsSolutionUsable()) write_poses();
    return summary;
  }

 private:
  static ceres::Problem::Options problem_options() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  void add(std::size_t k, const BundleProblem::Observation& o, bool robust) {
    double* pose = poses_[o.pose].data();
    double* point = bundle_.points[k].data();
    const float inv_sigma = bundle_.inv_sigma[o.noise];
    pose_used_[o.pose] = 1;
    point_used_[k] = 1;
    if (std::isnan(o.u_right)) {
      mono_costs_.emplace_back(&bundle_.camera, Eigen::Vector2d(o.u, o.v), inv_sigma,
                               bundle_.ratio);
      problem_.AddResidualBlock(&mono_costs_.back(), loss(k, robust ? &loss_mono_ : nullptr), pose,
                                point);
    } else {
      stereo_costs_.emplace_back(&bundle_.camera, Eigen::Vector3d(o.u, o.v, o.u_right), inv_sigma,
                                 bundle_.ratio);
      problem_.AddResidualBlock(&stereo_costs_.back(), loss(k, robust ? &loss_stereo_ : nullptr),
                                pose, point);
    }
  }

  /// The loss, which may be null, times its point's weight.
  ceres::LossFunction* loss(std::size_t point, ceres::LossFunction* robust) {
    if (bundle_.weights.empty() || bundle_.weights[point] == 1) return robust;
    weighted_losses_.push_back(std::make_unique<ceres::ScaledLoss>(
        robust, static_cast<double>(bundle_.weights[point]), ceres::DO_NOT_TAKE_OWNERSHIP));
    return weighted_losses_.back().get();
  }

  std::shared_ptr<ceres::ParameterBlockOrdering> points_first() {
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (std::size_t i = 0; i < point_used_.size(); ++i) {
      if (point_used_[i] != 0) ordering->AddElementToGroup(bundle_.points[i].data(), 0);
    }
    for (std::size_t i = 0; i < pose_used_.size(); ++i) {
      if (pose_used_[i] != 0) ordering->AddElementToGroup(poses_[i].data(), 1);
    }
    return ordering;
  }

  void write_poses() {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (pose_used_[i] != 0) bundle_.T_c_w[i] = to_pose(poses_[i].data());
    }
  }

  BundleProblem& bundle_;
  ceres::HuberLoss loss_stereo_;
  ceres::HuberLoss loss_mono_;
  std::deque<StereoReprojectionCost> stereo_costs_;  // Ceres keeps pointers to them
  std::deque<MonoReprojectionCost> mono_costs_;
  std::deque<MotionCost> motion_costs_;
  std::vector<std::unique_ptr<ceres::ScaledLoss>> weighted_losses_;
  PoseManifold manifold_;
  std::vector<PoseBlock> poses_;
  std::vector<std::uint8_t> pose_used_;
  std::vector<std::uint8_t> point_used_;
  int free_poses_ = 0;
  ceres::Problem problem_;
};

}  // namespace

BundleRoundSummary solve_bundle_ceres(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round) {
  if (options.disparity_weight != 1) {
    throw std::invalid_argument("solve_bundle_ceres: disparity_weight is not for Ceres");
  }
  return CeresBundle(problem, options, round).solve(options, round.iterations);
}

}  // namespace kys_slam
