// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/bundle_adjustment.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "geometry/reprojection.h"
#include "optimization/bundle_solver.h"

namespace kys_slam {

void describe(kys::OptionList& list, BundleOptions& o, std::string_view prefix) {
  const auto key = [&](const char* name) { return std::string(prefix) + name; };
  list.add(key("iterations"), o.iterations, {0, 1000}, "", "iterations of the robust round");
  list.add(key("refine_iterations"), o.refine_iterations, {0, 1000}, "",
           "iterations after removal of outliers");
  const kys::OptionList::Fixed fixed(list);
  list.add(key("chi2_mono"), o.chi2_mono, {0.1, 1e6});
  list.add(key("chi2_stereo"), o.chi2_stereo, {0.1, 1e6});
  list.add(key("min_pose_observations"), o.min_pose_observations, {0, 60000});
  list.add(key("disparity_weight"), o.disparity_weight, {1e-6, 1e6});
  list.add(key("function_tolerance"), o.function_tolerance, {0, 1});
}
namespace {

using Observation = BundleProblem::Observation;

void check(const BundleProblem& problem) {
  if (!problem.camera.is_valid()) throw std::invalid_argument("adjust_bundle: bad camera");
  if (problem.pose_fixed.size() != problem.T_c_w.size()) {
    throw std::invalid_argument("adjust_bundle: pose_fixed and T_c_w differ in length");
  }
  if (!problem.weights.empty() && problem.weights.size() != problem.points.size()) {
    throw std::invalid_argument("adjust_bundle: weights and points differ in length");
  }
  if (problem.first.size() != problem.points.size() + 1 || problem.first.front() != 0 ||
      !std::ranges::is_sorted(problem.first) ||
      static_cast<std::size_t>(problem.first.back()) != problem.observations.size()) {
    throw std::invalid_argument("adjust_bundle: observations that are not those of the points");
  }
  for (const Observation& o : problem.observations) {
    if (o.pose >= problem.T_c_w.size() || o.noise >= problem.inv_sigma.size()) {
      throw std::invalid_argument("adjust_bundle: observation of a pose or noise out of range");
    }
  }
  for (const MotionTerm& m : problem.motions) {
    const bool in_range = std::max(m.a, m.b) < problem.T_c_w.size() && m.a != m.b;
    if (!in_range || !m.T_a_b.is_finite() || !(m.sigma_position > 0) || !(m.sigma_rotation > 0)) {
      throw std::invalid_argument("adjust_bundle: motion of poses out of range, or not finite");
    }
  }
}

/// Poses with rotations ready, and what an observation needs of them.
class Errors {
 public:
  explicit Errors(const BundleProblem& problem) : problem_(problem) {
    rotations_.reserve(problem.T_c_w.size());
    for (const Rigid3& T : problem.T_c_w) rotations_.push_back(T.R());
  }

  [[nodiscard]] bool is_finite(const Observation& o) const {
    return is_usable(o.u, o.v, o.u_right, problem_.inv_sigma[o.noise]) &&
           problem_.T_c_w[o.pose].is_finite();
  }
  /// Squared error over variance; `in_front` tells on which side of the camera the point is.
  [[nodiscard]] double chi2(const Eigen::Vector3d& p_w, const Observation& o,
                            double disparity_weight, bool& in_front) const {
    const Eigen::Vector3d p_c = rotations_[o.pose] * p_w + problem_.T_c_w[o.pose].translation;
    in_front = p_c.z() >= kMinDepth;
    const Eigen::Vector3d e = reprojection_error(problem_.camera, p_c, o.u, o.v, o.u_right);
    const InformationRatio& ratio = problem_.ratio;
    double sum = e.x() * e.x() + ratio.v * e.y() * e.y();
    if (!std::isnan(o.u_right)) sum += disparity_weight * ratio.disparity * e.z() * e.z();
    const float inv_sigma = problem_.inv_sigma[o.noise];
    return sum * inv_sigma * inv_sigma;
  }

 private:
  const BundleProblem& problem_;
  std::vector<Eigen::Matrix3d> rotations_;
};

/// Calls f(index, point) for the observations of points that are finite.
template <typename F>
void for_each_observation(const BundleProblem& problem, F&& f) {
  for (std::size_t k = 0; k < problem.points.size(); ++k) {
    if (!is_usable(problem.points[k])) continue;
    const auto end = static_cast<std::size_t>(problem.first[k + 1]);
    for (auto i = static_cast<std::size_t>(problem.first[k]); i < end; ++i) f(i, problem.points[k]);
  }
}

/// Observations of the first round: finite, and in front of the camera.
std::vector<std::uint8_t> usable_observations(const BundleProblem& problem) {
  const Errors errors(problem);
  std::vector<std::uint8_t> active(problem.observations.size(), 0);
  for_each_observation(problem, [&](std::size_t i, const Eigen::Vector3d& p_w) {
    const Observation& o = problem.observations[i];
    bool in_front = false;
    if (!errors.is_finite(o)) return;
    static_cast<void>(errors.chi2(p_w, o, 1, in_front));
    active[i] = in_front ? 1 : 0;
  });
  return active;
}

std::vector<std::uint8_t> find_outliers(const BundleProblem& problem,
                                        const BundleOptions& options) {
  const Errors errors(problem);
  std::vector<std::uint8_t> outlier(problem.observations.size(), 1);
  for_each_observation(problem, [&](std::size_t i, const Eigen::Vector3d& p_w) {
    const Observation& o = problem.observations[i];
    if (!errors.is_finite(o)) return;
    bool in_front = false;
    const double chi2 = errors.chi2(p_w, o, options.disparity_weight, in_front);
    const double bound = std::isnan(o.u_right) ? options.chi2_mono : options.chi2_stereo;
    outlier[i] = in_front && chi2 <= bound ? 0 : 1;
  });
  return outlier;
}

/// In the memory of `outlier`.
std::vector<std::uint8_t> inliers(std::vector<std::uint8_t> outlier) {
  for (std::uint8_t& o : outlier) o = o == 0 ? 1 : 0;
  return outlier;
}

/// Free poses with too few active observations get their initial value again, and their
/// observations become inactive. Returns whether there are new poses of this kind.
bool fix_unconstrained(BundleProblem& problem, const BundleOptions& options,
                       const std::vector<Rigid3>& before, std::vector<std::uint8_t>& active,
                       std::vector<std::uint8_t>& unconstrained) {
  std::vector<int> count(before.size(), 0);
  for (std::size_t i = 0; i < active.size(); ++i) {
    count[problem.observations[i].pose] += active[i] != 0 ? 1 : 0;
  }
  bool any = false;
  for (std::size_t k = 0; k < before.size(); ++k) {
    if (problem.pose_fixed[k] != 0 || unconstrained[k] != 0) continue;
    if (count[k] >= options.min_pose_observations) continue;
    problem.T_c_w[k] = before[k];
    unconstrained[k] = 1;
    any = true;
  }
  for (std::size_t i = 0; i < active.size(); ++i) {
    if (unconstrained[problem.observations[i].pose] != 0) active[i] = 0;
  }
  return any;
}

/// The fixed poses, or if there are none, the first that is observed.
std::vector<std::uint8_t> hold_gauge(const BundleProblem& problem,
                                     const std::vector<std::uint8_t>& active) {
  std::vector<std::uint8_t> fixed = problem.pose_fixed;
  std::int32_t first = -1;
  for (std::size_t i = 0; i < active.size(); ++i) {
    if (active[i] == 0) continue;
    const auto pose = static_cast<std::int32_t>(problem.observations[i].pose);
    if (fixed[pose] != 0) return fixed;
    if (first < 0 || pose < first) first = pose;
  }
  if (first >= 0) fixed[first] = 1;
  return fixed;
}

BundleSolver choose_solver(const BundleOptions& options, const std::vector<std::uint8_t>& fixed) {
  if (options.solver != BundleSolver::kAuto) return options.solver;
  const auto free_poses = std::count(fixed.begin(), fixed.end(), 0);
  return free_poses <= kDenseMaxPoses ? BundleSolver::kSchur : BundleSolver::kSparseSchur;
}

BundleRoundSummary run_round(BundleProblem& problem, const BundleOptions& options,
                             const std::vector<std::uint8_t>& active, bool robust, int iterations) {
  const std::vector<std::uint8_t> fixed = hold_gauge(problem, active);
  const BundleSolver solver = choose_solver(options, fixed);
  const BundleRound round{active, fixed, robust, iterations, solver == BundleSolver::kSparseSchur};
  return options.round_solver != nullptr ? options.round_solver(problem, options, round)
                                         : solve_bundle_schur(problem, options, round);
}

}  // namespace

BundleSummary adjust_bundle(BundleProblem& problem, const BundleOptions& options) {
  check(problem);
  if (!(options.disparity_weight > 0)) {
    throw std::invalid_argument("adjust_bundle: disparity_weight must be positive");
  }
  BundleSummary summary;
  const std::vector<Rigid3> before = problem.T_c_w;
  summary.unconstrained.resize(before.size(), 0);
  std::vector<std::uint8_t> active = usable_observations(problem);
  fix_unconstrained(problem, options, before, active, summary.unconstrained);
  const BundleRoundSummary first =
      run_round(problem, options, active, options.robust, options.iterations);
  summary.initial_cost = first.initial_cost;
  summary.final_cost = first.final_cost;
  summary.iterations = first.iterations;
  summary.stopped = first.stopped;
  summary.outlier = find_outliers(problem, options);

  if (options.refine_iterations > 0 && !first.stopped) {
    active = inliers(std::move(summary.outlier));
    fix_unconstrained(problem, options, before, active, summary.unconstrained);
    const BundleRoundSummary second =
        run_round(problem, options, active, false, options.refine_iterations);
    summary.final_cost = second.final_cost;
    summary.iterations += second.iterations;
    summary.stopped = second.stopped;
    summary.outlier = find_outliers(problem, options);
  }
  active = inliers(summary.outlier);
  if (fix_unconstrained(problem, options, before, active, summary.unconstrained)) {
    summary.outlier = find_outliers(problem, options);
  }
  return summary;
}

}  // namespace kys_slam
