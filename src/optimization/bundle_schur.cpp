// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "geometry/levenberg.h"
#include "geometry/so3.h"
#include "optimization/bundle_reduction.h"
#include "optimization/eliminated_point.h"
#include "optimization/schur_kernels.h"

// Levenberg-Marquardt on the normal equations of bundle adjustment with the points eliminated
// (Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 6.1). The reduced system is dense
// for windows of few poses and sparse, by blocks, for whole maps (bundle_reduction.h).
// The increment of a pose is that of the camera frame, p_c -> exp(w) p_c + v, which has the
// sparsest Jacobian. A point's blocks never leave the cache: its observations are linearised and
// eliminated in one go, and only what back-substitution needs is kept.

namespace kys_slam {
namespace {

using namespace schur;

constexpr double kInitialDamping = 1e-4;
constexpr std::size_t kPointsBetweenStops = 4096;  // some ms
constexpr int kPointRounds = 2;
constexpr double kPointDamping = 1e-3;

class SchurBundle {
 public:
  SchurBundle(BundleProblem& problem, const BundleOptions& options, const BundleRound& round)
      : problem_(problem),
        options_(options),
        bundle_(problem, round),
        reduction_(round.sparse ? sparse_reduction(bundle_) : dense_reduction(bundle_)),
        view_{CameraNumbers(problem.camera),
              nullptr,
              bundle_.free_index().data(),
              round.robust,
              problem.ratio.v,
              options.disparity_weight * problem.ratio.disparity,
              options.chi2_mono,
              options.chi2_stereo},
        free_index_(bundle_.free_index()),
        free_pose_(bundle_.free_poses()),
        points_(bundle_.points()),
        free_(kLanes * bundle_.most_groups()),
        mixed_(bundle_.most_groups()),
        sums_(free_pose_.size()),
        pose_damping_(free_pose_.size()),
        pose_step_(free_pose_.size()),
        lane_steps_(free_pose_.size() + 1),
        flat_gradient_(static_cast<Eigen::Index>(6 * free_pose_.size())),
        Z_(free_.size()) {
    update_matrices();
  }

  BundleRoundSummary solve(int iterations) {
    if (points_.empty()) {
      const double cost = this->cost();
      return {cost, cost};
    }
    const LevenbergOptions levenberg_options{iterations, options_.function_tolerance, true,
                                             options_.stop};
    const LevenbergSummary s = levenberg(*this, Damping(kInitialDamping), levenberg_options);
    return {s.initial_cost, s.final_cost, s.iterations, s.stopped};
  }

  // What levenberg() calls.

  /// At the present poses and points.
  [[nodiscard]] double cost() const {
    double sum = 0;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      sum += loss(points_[k], reduction_->groups_of(k), problem_.points[points_[k].point]);
    }
    for (const MotionTerm& motion : problem_.motions) {
      sum += cost_of(motion, problem_.T_c_w[motion.a], problem_.T_c_w[motion.b]);
    }
    return sum;
  }

  /// Linearises and eliminates every point, solves, and moves poses and points.
  LevenbergStep step(double damping) {
    using Outcome = LevenbergStep::Outcome;
    reduction_->begin_step();
    for (Matrix6d& m : reduction_->blocks()) m.setZero();
    sums_.assign(sums_.size(), {});
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (i % kPointsBetweenStops == 0 && is_set(options_.stop)) return {Outcome::kStopped};
      take_in(i, damping);
    }
    for (const MotionTerm& motion : problem_.motions) take_in(motion);
    const BundleReduction::Result solved = solve_reduced(damping);
    if (solved == BundleReduction::Result::kStopped) return {Outcome::kStopped};
    if (solved == BundleReduction::Result::kNoFactor) return {Outcome::kNone};
    const double predicted = back_substitute(damping);
    if (!std::isfinite(predicted) || predicted < 0) return {Outcome::kNone};
    move();
    return {Outcome::kTaken, predicted};
  }

  [[nodiscard]] double cost_of_step() {
    if (reduction_->iterates_points() || options_.iterate_points) iterate_points();
    return cost();
  }

  void accept() {}

  void restore() {
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      problem_.T_c_w[free_pose_[r]] = old_poses_[r];
    }
    swap_points();
    update_matrices();
  }

 private:
  using Point = BundlePoints::Point;

  void update_matrices() {
    matrices_.resize(problem_.T_c_w.size() + 1);
    for (std::size_t i = 0; i < problem_.T_c_w.size(); ++i) {
      using RowMajor = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
      Eigen::Map<RowMajor>(matrices_[i].rows.data()) = problem_.T_c_w[i].matrix();
    }
    matrices_.back() = matrices_.front();
    view_.poses = matrices_.data();
  }

  [[nodiscard]] PointView view_of(const Point& point, const Eigen::Vector3d& p_w) const {
    return {p_w.data(), problem_.weights.empty() ? 1 : problem_.weights[point.point]};
  }
  [[nodiscard]] PointView view_of(const Point& point) const {
    return view_of(point, problem_.points[point.point]);
  }

  /// 1/2 the sum of rho over the point's observations, the point being at p_w.
  [[nodiscard]] double loss(const Point& point, const ObservationLanes* groups,
                            const Eigen::Vector3d& p_w) const {
    return cost_of(groups, point.groups(), view_, view_of(point, p_w));
  }

  /// After a step, optimises every point alone, with the new poses fixed (Jeong et al.,
  /// "Pushing the envelope of modern methods for bundle adjustment", 2012, Sec. 4: embedded point
  /// iterations). The linear model is poor for the few points with little parallax; without this
  /// they cause the rejection of steps that are good for all other points.
  void iterate_points() {
    const std::span<Eigen::Vector3d> other_points = reduction_->other_points();
    for (std::size_t k = 0; k < points_.size(); ++k) {
      if (k % kPointsBetweenStops == 0 && is_set(options_.stop)) return;
      const Point& point = points_[k];
      const ObservationLanes* groups = reduction_->groups_of(k);
      Eigen::Vector3d& p_w = problem_.points[point.point];
      double cost = loss(point, groups, p_w);
      if (const double before = loss(point, groups, other_points[k]); before < cost) {
        p_w = other_points[k];
        cost = before;
      }
      for (int round = 0; round < kPointRounds; ++round) {
        const Eigen::Vector3d moved = p_w + point_newton_step(point, groups, p_w);
        const double after = loss(point, groups, moved);
        if (!(after < cost)) break;
        p_w = moved;
        cost = after;
      }
    }
  }

  /// Gauss-Newton step of one point, the poses held.
  [[nodiscard]] Eigen::Vector3d point_newton_step(const Point& point,
                                                  const ObservationLanes* groups,
                                                  const Eigen::Vector3d& p_w) const {
    PointNormal normal;
    point_normal_of(groups, point.groups(), view_, view_of(point, p_w), normal);
    Eigen::Matrix3d V = lower_of(normal.V);
    const Eigen::Vector3d b(normal.b);
    V.diagonal() += kPointDamping * V.diagonal().cwiseMax(Damping::kMinDiagonal);
    const Eigen::Matrix3d L_inverse = inverse_of_cholesky(V);
    return -(L_inverse.transpose() * (L_inverse * b));
  }

  /// Adds a point's observations to the reduced system.
  void take_in(std::size_t index, double damping) {
    const Point& point = points_[index];
    const ReducedSystem system{reduction_->blocks().data(), &reduction_->places(), sums_.data()};
    const ObservationLanes* groups = reduction_->groups_of(index);
    for (std::int32_t g = 0; g < point.groups(); ++g) {
      look_up_free(groups[g], view_, free_.data() + kLanes * g);
    }
    PointNormal normal;
    linearise(groups, free_.data(), point.groups(), view_, view_of(point), mixed_.data(), normal);
    const EliminatedPoint e = kys_slam::eliminated(normal, damping);
    reduction_->keep(index, e);
    const Eigen::Vector3d y = lower_of(e.L_inverse) * e.b;
    eliminate(free_.data(), point.count, mixed_.data(), e.L_inverse.data(), y.data(), Z_.data(),
              system);
  }

  /// Adds an expected motion.
  void take_in(const MotionTerm& motion) {
    const std::int32_t a = free_index_[motion.a];
    const std::int32_t b = free_index_[motion.b];
    if (a < 0 && b < 0) return;
    const MotionNormal normal =
        normal_of(motion, problem_.T_c_w[motion.a], problem_.T_c_w[motion.b]);
    const auto add = [&](std::int32_t pose, const Matrix6d& own, const Vector6d& gradient) {
      if (pose < 0) return;
      reduction_->block(pose, pose) += own;
      sums_[pose].gradient() += gradient;
      sums_[pose].diagonal() += own.diagonal();
    };
    add(a, normal.aa, normal.a);
    add(b, normal.bb, normal.b);
    if (a < 0 || b < 0) return;
    if (a > b) {
      reduction_->block(a, b) += normal.ab;
    } else {
      reduction_->block(b, a) += normal.ab.transpose();
    }
  }

  /// A point as it was eliminated.
  [[nodiscard]] EliminatedPoint eliminated(std::size_t index, const ObservationLanes* groups,
                                           double damping) const {
    if (const EliminatedPoint* kept = reduction_->kept(index)) return *kept;
    const Point& point = points_[index];
    PointNormal normal;
    point_normal_of(groups, point.groups(), view_, view_of(point), normal);
    return kys_slam::eliminated(normal, damping);
  }

  /// Solves for the increments of the poses.
  BundleReduction::Result solve_reduced(double damping) {
    using Result = BundleReduction::Result;
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    if (poses == 0) return Result::kDone;
    for (std::int32_t r = 0; r < poses; ++r) {
      // The point terms have been taken off already; the damping is that of the full diagonal.
      pose_damping_[r] = damping * sums_[r].diagonal().cwiseMax(Damping::kMinDiagonal);
      reduction_->block(r, r).diagonal() += pose_damping_[r];
      flat_gradient_.segment<6>(6 * r) = -sums_[r].gradient();
    }
    const Result result = reduction_->solve(flat_gradient_, options_.stop);
    if (result != Result::kDone) return result;
    for (std::int32_t r = 0; r < poses; ++r) pose_step_[r] = flat_gradient_.segment<6>(6 * r);
    return flat_gradient_.allFinite() ? Result::kDone : Result::kNoFactor;
  }

  /// Increments of the points, and the decrease predicted for the whole step:
  /// 1/2 (step^T damping step - step^T gradient), with the gradient before elimination.
  double back_substitute(double damping) {
    const std::span<Eigen::Vector3d> other_points = reduction_->other_points();
    double predicted = 0;
    for (std::size_t r = 0; r < pose_step_.size(); ++r) {
      predicted += pose_step_[r].dot(pose_damping_[r].cwiseProduct(pose_step_[r]));
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data()) = pose_step_[r].head<3>();
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data() + 4) = pose_step_[r].tail<3>();
      predicted -=
          pose_step_[r].dot(sums_[r].gradient());  // reduced: the point part is added below
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const Point& point = points_[k];
      const ObservationLanes* groups = reduction_->groups_of(k);
      const EliminatedPoint e = eliminated(k, groups, damping);
      Eigen::Vector3d gradient;
      moved_gradient(groups, point.groups(), view_, view_of(point), lane_steps_.data(),
                     gradient.data());
      const Eigen::Matrix3d L_inverse = lower_of(e.L_inverse);
      const Eigen::Vector3d moved = L_inverse * gradient;  // sum of Z^T pose_step
      const Eigen::Vector3d y = L_inverse * e.b;
      const Eigen::Vector3d step = -(L_inverse.transpose() * (y + moved));
      other_points[k] = problem_.points[point.point] + step;
      predicted += step.dot(e.damping.cwiseProduct(step));
      predicted -= step.dot(e.b) + moved.dot(y);
    }
    return 0.5 * predicted;
  }

  void move() {
    old_poses_.clear();
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      Rigid3& T = problem_.T_c_w[free_pose_[r]];
      old_poses_.push_back(T);
      T = plus_left(T, pose_step_[r]);
    }
    swap_points();
    update_matrices();
  }

  void swap_points() {
    const std::span<Eigen::Vector3d> other_points = reduction_->other_points();
    for (std::size_t k = 0; k < points_.size(); ++k) {
      std::swap(problem_.points[points_[k].point], other_points[k]);
    }
  }

  template <typename T>
  using AlignedVector = std::vector<T, Eigen::aligned_allocator<T>>;

  BundleProblem& problem_;
  const BundleOptions& options_;
  BundlePoints bundle_;
  std::unique_ptr<BundleReduction> reduction_;
  View view_;
  const std::vector<std::int32_t>& free_index_;
  const std::vector<std::int32_t>& free_pose_;
  const std::vector<Point>& points_;
  std::vector<std::int32_t> free_;  // of the point worked on
  std::vector<MixedLanes> mixed_;   // the same
  std::vector<PoseMatrix> matrices_;
  std::vector<PoseSums> sums_;
  AlignedVector<Vector6d> pose_damping_;
  AlignedVector<Vector6d> pose_step_;
  std::vector<PoseStep> lane_steps_;  // the same for lanes; the first is for what is fixed
  Eigen::VectorXd flat_gradient_;
  AlignedVector<Matrix63> Z_;  // of the point worked on
  std::vector<Rigid3> old_poses_;
};

}  // namespace

BundleRoundSummary solve_bundle_schur(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round) {
  return SchurBundle(problem, options, round).solve(round.iterations);
}

}  // namespace kys_slam
