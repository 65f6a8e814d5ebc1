// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/memory.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "optimization/block_cholesky.h"
#include "optimization/bundle_solver.h"
#include "optimization/damping.h"
#include "optimization/schur_kernels.h"
#include "util/page_array.h"

// Levenberg-Marquardt on the normal equations of bundle adjustment with the points eliminated
// (Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 6.1). The reduced system is dense
// for windows of few poses and sparse, by blocks, for whole maps; what comes before it is the same.
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

/// A point with active observations, and their number.
struct SchurPoint {
  std::int32_t point;
  std::int32_t count;

  [[nodiscard]] std::int32_t groups() const { return (count + kLanes - 1) / kLanes; }
};

/// What back-substitution and the gain ratio need of an eliminated point. Windows keep it; whole
/// maps compute it again.
struct EliminatedPoint {
  std::array<double, 6> L_inverse;  // of the Cholesky factor of V + damping: lower triangle by rows
  Eigen::Vector3d b;                // J^T W r
  Eigen::Vector3d damping;          // what was added to the diagonal of V
};

class SchurBundle {
 public:
  SchurBundle(BundleProblem& problem, const BundleOptions& options, const BundleRound& round)
      : problem_(problem),
        options_(options),
        view_{CameraNumbers(problem.camera),
              nullptr,
              nullptr,
              round.robust,
              problem.ratio.v,
              options.disparity_weight * problem.ratio.disparity,
              options.chi2_mono,
              options.chi2_stereo},
        active_(round.active) {
    number_free_poses(round);
    find_observations();
    if (!round.sparse) pack_all();
    if (round.sparse) {
      pattern_ = needed_blocks();
      sparse_.emplace(pattern_);
      use_order_ = sparse_->use_order();
      places_ = BlockPlaces(pattern_, use_order_);
      sparse_blocks_ = PageArray<Matrix6d>(pattern_.column.size());
      reduced_ = {sparse_blocks_.data(), sparse_blocks_.size()};
      sparse_points_ = PageArray<Eigen::Vector3d>(points_.size());
      other_points_ = {sparse_points_.data(), sparse_points_.size()};
    } else {
      pattern_ = all_blocks();
      places_ = BlockPlaces(pattern_);
      dense_blocks_.resize(pattern_.column.size());
      reduced_ = dense_blocks_;
      dense_points_.resize(points_.size());
      other_points_ = dense_points_;
    }
    sums_.resize(free_pose_.size());
    lane_steps_.resize(free_pose_.size() + 1);
    pose_damping_.resize(free_pose_.size());
    pose_step_.resize(free_pose_.size());
    if (!round.sparse) eliminated_.resize(points_.size());
    const auto size = static_cast<Eigen::Index>(6 * free_pose_.size());
    if (!round.sparse) dense_.resize(size, size);
    flat_gradient_.resize(size);
    if (round.sparse) return_freed_memory();  // that of the analysis of the pattern
  }

  BundleRoundSummary solve(int iterations) {
    BundleRoundSummary summary;
    update_matrices();
    double cost = evaluate();
    summary.initial_cost = summary.final_cost = cost;
    if (points_.empty()) return summary;
    Damping damping(kInitialDamping);
    while (summary.iterations < iterations && !damping.exhausted()) {
      if (should_stop()) {
        summary.stopped = true;
        break;
      }
      ++summary.iterations;
      const double predicted = step(damping.value());
      if (stopped_) {  // nothing has moved
        summary.stopped = true;
        break;
      }
      if (!(predicted >= 0)) {  // no factorisation, or NaN
        damping.refuse();
        continue;
      }
      if (predicted <= 1e-3 * options_.function_tolerance * cost) break;
      if (sparse_ || options_.iterate_points) iterate_points();
      const double candidate = evaluate();
      const double decrease = cost - candidate;
      const double gain = decrease / predicted;
      if (gain > Damping::kMinGain) {
        const bool converged = decrease <= options_.function_tolerance * cost;
        cost = candidate;
        damping.accept(gain);
        if (converged) break;
      } else {
        restore();
        if (std::abs(decrease) <= options_.function_tolerance * cost) break;
        damping.refuse();
      }
    }
    summary.final_cost = cost;
    return summary;
  }

 private:
  [[nodiscard]] bool should_stop() const {
    return options_.stop != nullptr && options_.stop->load(std::memory_order_relaxed);
  }

  void number_free_poses(const BundleRound& round) {
    std::vector<std::uint8_t> used(problem_.T_c_w.size(), 0);
    for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
      if (round.active[i] != 0) used[problem_.observations[i].pose] = 1;
    }
    free_index_.assign(problem_.T_c_w.size() + 1, -1);
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i] == 0 || round.pose_fixed[i] != 0) continue;
      free_index_[i] = static_cast<std::int32_t>(free_pose_.size());
      free_pose_.push_back(static_cast<std::int32_t>(i));
    }
    view_.free = free_index_.data();
  }

  /// Finds the active observations of every point, those of a point in order of free pose, so that
  /// sums run in the same order however the caller listed them.
  void find_observations() {
    points_.reserve(problem_.points.size());
    for (std::size_t k = 0; k < problem_.points.size(); ++k) {
      const auto begin = active_.begin() + problem_.first[k];
      const auto end = active_.begin() + problem_.first[k + 1];
      const auto count = static_cast<std::int32_t>(end - begin - std::count(begin, end, 0));
      if (count > 0) points_.push_back({static_cast<std::int32_t>(k), count});
    }
    if (!is_ordered()) sort_observations();
    std::int32_t most = 0;
    for (const SchurPoint& point : points_) most = std::max(most, point.groups());
    mixed_.resize(static_cast<std::size_t>(most));
    Z_.resize(static_cast<std::size_t>(kLanes * most));
    free_.resize(Z_.size());
    packed_.resize(mixed_.size());
  }

  /// Whether the active observations of every point are in order of free pose already: those of
  /// whole maps are, and need no list of their order.
  [[nodiscard]] bool is_ordered() const {
    for (const SchurPoint& point : points_) {
      std::int32_t last = -1;
      bool ordered = true;
      for_each_observation(point, [&](const BundleProblem::Observation& o) {
        ordered = ordered && free_index_[o.pose] >= last;
        last = free_index_[o.pose];
      });
      if (!ordered) return false;
    }
    return true;
  }

  void sort_observations() {
    std::vector<std::int32_t> order(active_.size());
    const auto free_of = [&](std::int32_t i) { return free_index_[problem_.observations[i].pose]; };
    const auto earlier = [&](std::int32_t a, std::int32_t b) { return free_of(a) < free_of(b); };
    for (const SchurPoint& point : points_) {
      const auto begin = order.begin() + problem_.first[point.point];
      auto end = begin;
      for (std::int32_t i = problem_.first[point.point]; end - begin < point.count; ++i) {
        if (active_[i] != 0) *end++ = i;
      }
      if (!std::is_sorted(begin, end, earlier)) std::stable_sort(begin, end, earlier);
    }
    order_ = std::move(order);
  }

  /// Calls f(observation) for those of a point, in order.
  template <typename F>
  void for_each_observation(const SchurPoint& point, F&& f) const {
    std::int32_t i = problem_.first[point.point];
    if (!order_.empty()) {
      for (std::int32_t k = 0; k < point.count; ++k) f(problem_.observations[order_[i + k]]);
      return;
    }
    for (std::int32_t k = 0; k < point.count; ++i) {
      if (active_[i] == 0) continue;
      f(problem_.observations[i]);
      ++k;
    }
  }

  /// Windows keep the groups of all points.
  void pack_all() {
    if (points_.empty()) return;
    std::int32_t all = 0;
    for (const SchurPoint& point : points_) {
      first_group_.push_back(all);
      all += point.groups();
    }
    groups_.resize(static_cast<std::size_t>(all));
    for (std::size_t k = 0; k < points_.size(); ++k) {
      pack(points_[k], groups_.data() + first_group_[k]);
    }
  }

  void pack(const SchurPoint& point, ObservationLanes* to) const {
    ObservationLanes none;
    none.pose.fill(static_cast<std::int32_t>(problem_.T_c_w.size()));
    std::fill_n(to, point.groups(), none);
    std::int32_t k = 0;
    for_each_observation(point, [&](const BundleProblem::Observation& o) {
      pack(o, k % kLanes, to[k / kLanes]);
      ++k;
    });
  }

  /// The groups of a point, until those of another are asked for. Whole maps pack them every time:
  /// kept, they were a fifth of the memory of their adjustment.
  const ObservationLanes* groups_of(std::size_t index) const {
    if (!groups_.empty()) return groups_.data() + first_group_[index];
    pack(points_[index], packed_.data());
    return packed_.data();
  }

  [[nodiscard]] BlockPattern all_blocks() const {
    BlockPattern pattern;
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t c = 0; c <= r; ++c) pattern.column.push_back(c);
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  /// Pairs of free poses with an expected motion, the later one first, in order.
  [[nodiscard]] std::vector<std::pair<std::int32_t, std::int32_t>> moving_pairs() const {
    std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
    for (const MotionTerm& motion : problem_.motions) {
      const std::int32_t a = free_index_[motion.a];
      const std::int32_t b = free_index_[motion.b];
      if (a >= 0 && b >= 0) pairs.emplace_back(std::max(a, b), std::min(a, b));
    }
    std::sort(pairs.begin(), pairs.end());
    return pairs;
  }

  /// Blocks of poses that see a point together or have an expected motion.
  [[nodiscard]] BlockPattern needed_blocks() const {
    std::vector<std::int32_t> free_of;      // per observation, by point
    std::vector<std::int32_t> first_of{0};  // per point: the first of its observations
    free_of.reserve(active_.size());
    first_of.reserve(points_.size() + 1);
    for (const SchurPoint& p : points_) {
      for_each_observation(
          p, [&](const BundleProblem::Observation& o) { free_of.push_back(free_index_[o.pose]); });
      first_of.push_back(static_cast<std::int32_t>(free_of.size()));
    }
    // Observations by free pose, so that a row is finished before the next.
    std::vector<std::int32_t> begin(free_pose_.size() + 1, 0);
    for (const std::int32_t r : free_of) {
      if (r >= 0) ++begin[r + 1];
    }
    for (std::size_t r = 1; r < begin.size(); ++r) begin[r] += begin[r - 1];
    std::vector<std::int32_t> point_of(static_cast<std::size_t>(begin.back()));
    std::vector<std::int32_t> next(begin.begin(), begin.end() - 1);
    for (std::size_t k = 0; k < points_.size(); ++k) {
      for (std::int32_t i = first_of[k]; i < first_of[k + 1]; ++i) {
        const std::int32_t r = free_of[i];
        if (r >= 0) point_of[next[r]++] = static_cast<std::int32_t>(k);
      }
    }
    BlockPattern pattern;
    std::vector<std::int32_t> seen_by(free_pose_.size(), -1);
    const auto pairs = moving_pairs();
    auto pair = pairs.begin();
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t k = begin[r]; k < begin[r + 1]; ++k) {
        const std::int32_t point = point_of[k];
        for (std::int32_t i = first_of[point]; i < first_of[point + 1]; ++i) {
          const std::int32_t c = free_of[i];
          if (c > r) break;
          if (c < 0 || seen_by[c] == r) continue;
          seen_by[c] = r;
          pattern.column.push_back(c);
        }
      }
      for (; pair != pairs.end() && pair->first == r; ++pair) {
        if (std::exchange(seen_by[pair->second], r) != r) pattern.column.push_back(pair->second);
      }
      std::sort(pattern.column.begin() + pattern.row_begin.back(), pattern.column.end());
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  void pack(const BundleProblem::Observation& o, int lane, ObservationLanes& to) const {
    to.u[lane] = o.u;
    to.v[lane] = o.v;
    to.u_right[lane] = o.u_right;
    to.inv_sigma[lane] = problem_.inv_sigma[o.noise];
    to.pose[lane] = static_cast<std::int32_t>(o.pose);
  }

  void update_matrices() {
    matrices_.resize(problem_.T_c_w.size() + 1);
    for (std::size_t i = 0; i < problem_.T_c_w.size(); ++i) {
      using RowMajor = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
      Eigen::Map<RowMajor>(matrices_[i].rows.data()) = problem_.T_c_w[i].matrix();
    }
    matrices_.back() = matrices_.front();
    view_.poses = matrices_.data();
  }

  [[nodiscard]] PointView view_of(const SchurPoint& point, const Eigen::Vector3d& p_w) const {
    return {p_w.data(), problem_.weights.empty() ? 1 : problem_.weights[point.point]};
  }
  [[nodiscard]] PointView view_of(const SchurPoint& point) const {
    return view_of(point, problem_.points[point.point]);
  }

  /// 1/2 the sum of rho over the point's observations, the point being at p_w.
  [[nodiscard]] double loss(const SchurPoint& point, const ObservationLanes* groups,
                            const Eigen::Vector3d& p_w) const {
    return cost_of(groups, point.groups(), view_, view_of(point, p_w));
  }

  /// At the present poses and points.
  [[nodiscard]] double evaluate() const {
    double cost = 0;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      cost += loss(points_[k], groups_of(k), problem_.points[points_[k].point]);
    }
    for (const MotionTerm& motion : problem_.motions) {
      cost += cost_of(motion, problem_.T_c_w[motion.a], problem_.T_c_w[motion.b]);
    }
    return cost;
  }

  /// After a step, optimises every point alone, with the new poses fixed (Jeong et al.,
  /// "Pushing the envelope of modern methods for bundle adjustment", 2012, Sec. 4: embedded point
  /// iterations). The linear model is poor for the few points with little parallax; without this
  /// they cause the rejection of steps that are good for all other points.
  void iterate_points() {
    for (std::size_t k = 0; k < points_.size(); ++k) {
      if (k % kPointsBetweenStops == 0 && should_stop()) return;
      const SchurPoint& point = points_[k];
      const ObservationLanes* groups = groups_of(k);
      Eigen::Vector3d& p_w = problem_.points[point.point];
      double cost = loss(point, groups, p_w);
      if (const double before = loss(point, groups, other_points_[k]); before < cost) {
        p_w = other_points_[k];
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
  [[nodiscard]] Eigen::Vector3d point_newton_step(const SchurPoint& point,
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

  Matrix6d& block(std::int32_t row, std::int32_t col) { return reduced_[places_(row, col)]; }

  /// Linearises and eliminates every point, solves, and moves poses and points. Returns the
  /// decrease of the cost that the linear model predicts, or a negative number or NaN if there is
  /// no such step (nothing has moved then).
  double step(double damping) {
    // What one stage needs takes the memory of what the others needed.
    if (sparse_) sparse_points_.release(0, sparse_points_.size());
    for (Matrix6d& m : reduced_) m.setZero();
    sums_.assign(sums_.size(), {});
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (i % kPointsBetweenStops == 0 && should_stop()) {
        stopped_ = true;
        return -1;
      }
      take_in(i, damping);
    }
    for (const MotionTerm& motion : problem_.motions) take_in(motion);
    if (!solve_reduced(damping)) return -1;
    const double predicted = back_substitute(damping);
    if (std::isfinite(predicted) && predicted >= 0) apply();
    return predicted;
  }

  /// Adds a point's observations to the reduced system.
  void take_in(std::size_t index, double damping) {
    const SchurPoint& point = points_[index];
    const ReducedSystem system{reduced_.data(), &places_, sums_.data()};
    const ObservationLanes* groups = groups_of(index);
    for (std::int32_t g = 0; g < point.groups(); ++g) {
      look_up_free(groups[g], view_, free_.data() + kLanes * g);
    }
    PointNormal normal;
    linearise(groups, free_.data(), point.groups(), view_, view_of(point), mixed_.data(), normal);
    const EliminatedPoint e = eliminated(normal, damping);
    if (!sparse_) eliminated_[index] = e;
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
      block(pose, pose) += own;
      sums_[pose].gradient() += gradient;
      sums_[pose].diagonal() += own.diagonal();
    };
    add(a, normal.aa, normal.a);
    add(b, normal.bb, normal.b);
    if (a < 0 || b < 0) return;
    if (a > b) {
      block(a, b) += normal.ab;
    } else {
      block(b, a) += normal.ab.transpose();
    }
  }

  static EliminatedPoint eliminated(const PointNormal& normal, double damping) {
    EliminatedPoint e;
    Eigen::Matrix3d V = lower_of(normal.V);
    e.b = Eigen::Vector3d(normal.b);
    e.damping = damping * V.diagonal().cwiseMax(Damping::kMinDiagonal);
    V.diagonal() += e.damping;
    const Eigen::Matrix3d L = inverse_of_cholesky(V);
    e.L_inverse = {L(0, 0), L(1, 0), L(1, 1), L(2, 0), L(2, 1), L(2, 2)};
    return e;
  }

  /// A point as it was eliminated.
  [[nodiscard]] EliminatedPoint eliminated(std::size_t index, const ObservationLanes* groups,
                                           double damping) const {
    if (!sparse_) return eliminated_[index];
    const SchurPoint& point = points_[index];
    PointNormal normal;
    point_normal_of(groups, point.groups(), view_, view_of(point), normal);
    return eliminated(normal, damping);
  }

  /// The lower triangle is all that is read.
  template <typename Six>
  static Eigen::Matrix3d lower_of(const Six& n) {
    Eigen::Matrix3d lower;
    lower << n[0], 0, 0, n[1], n[2], 0, n[3], n[4], n[5];
    return lower;
  }

  /// Inverse of the lower Cholesky factor of a positive definite 3x3 matrix.
  static Eigen::Matrix3d inverse_of_cholesky(const Eigen::Matrix3d& V) {
    const double l00 = std::sqrt(V(0, 0));
    const double i00 = 1.0 / l00;
    const double l10 = V(1, 0) * i00;
    const double l20 = V(2, 0) * i00;
    const double i11 = 1.0 / std::sqrt(V(1, 1) - l10 * l10);
    const double l21 = (V(2, 1) - l20 * l10) * i11;
    const double i22 = 1.0 / std::sqrt(V(2, 2) - l20 * l20 - l21 * l21);
    Eigen::Matrix3d inverse;
    inverse << i00, 0, 0, -l10 * i00 * i11, i11, 0, (l10 * l21 * i11 - l20) * i00 * i22,
        -l21 * i11 * i22, i22;
    return inverse;
  }

  /// Solves for the increments of the poses.
  bool solve_reduced(double damping) {
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    if (poses == 0) return true;
    for (std::int32_t r = 0; r < poses; ++r) {
      // The point terms have been taken off already; the damping is that of the full diagonal.
      pose_damping_[r] = damping * sums_[r].diagonal().cwiseMax(Damping::kMinDiagonal);
      block(r, r).diagonal() += pose_damping_[r];
      flat_gradient_.segment<6>(6 * r) = -sums_[r].gradient();
    }
    if (!(sparse_ ? solve_sparse() : solve_dense())) return false;
    for (std::int32_t r = 0; r < poses; ++r) pose_step_[r] = flat_gradient_.segment<6>(6 * r);
    return flat_gradient_.allFinite();
  }

  bool solve_dense() {
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    for (std::int32_t r = 0; r < poses; ++r) {
      for (std::int32_t c = 0; c <= r; ++c) dense_.block<6, 6>(6 * r, 6 * c) = block(r, c);
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(dense_);
    if (factor.info() != Eigen::Success) return false;
    factor.solveInPlace(flat_gradient_);
    return true;
  }

  bool solve_sparse() {
    const BlockCholesky::Result result = sparse_->factorise(sparse_blocks_, options_.stop);
    stopped_ = result == BlockCholesky::Result::kStopped;
    if (result != BlockCholesky::Result::kDone) return false;
    sparse_->solve(flat_gradient_);
    sparse_->release_factor();
    return true;
  }

  /// Increments of the points, and the decrease predicted for the whole step:
  /// 1/2 (step^T damping step - step^T gradient), with the gradient before elimination.
  double back_substitute(double damping) {
    double predicted = 0;
    for (std::size_t r = 0; r < pose_step_.size(); ++r) {
      predicted += pose_step_[r].dot(pose_damping_[r].cwiseProduct(pose_step_[r]));
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data()) = pose_step_[r].head<3>();
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data() + 4) = pose_step_[r].tail<3>();
      predicted -=
          pose_step_[r].dot(sums_[r].gradient());  // reduced: the point part is added below
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const SchurPoint& point = points_[k];
      const ObservationLanes* groups = groups_of(k);
      const EliminatedPoint e = eliminated(k, groups, damping);
      Eigen::Vector3d gradient;
      moved_gradient(groups, point.groups(), view_, view_of(point), lane_steps_.data(),
                     gradient.data());
      const Eigen::Matrix3d L_inverse = lower_of(e.L_inverse);
      const Eigen::Vector3d moved = L_inverse * gradient;  // sum of Z^T pose_step
      const Eigen::Vector3d y = L_inverse * e.b;
      const Eigen::Vector3d step = -(L_inverse.transpose() * (y + moved));
      other_points_[k] = problem_.points[point.point] + step;
      predicted += step.dot(e.damping.cwiseProduct(step));
      predicted -= step.dot(e.b) + moved.dot(y);
    }
    return 0.5 * predicted;
  }

  void apply() {
    old_poses_.clear();
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      Rigid3& T = problem_.T_c_w[free_pose_[r]];
      old_poses_.push_back(T);
      T = plus_left(T, pose_step_[r]);
    }
    swap_points();
    update_matrices();
  }

  void restore() {
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      problem_.T_c_w[free_pose_[r]] = old_poses_[r];
    }
    swap_points();
    update_matrices();
  }

  void swap_points() {
    for (std::size_t k = 0; k < points_.size(); ++k) {
      std::swap(problem_.points[points_[k].point], other_points_[k]);
    }
  }

  template <typename T>
  using AlignedVector = std::vector<T, Eigen::aligned_allocator<T>>;

  BundleProblem& problem_;
  const BundleOptions& options_;
  View view_;
  bool stopped_ = false;                  // in the middle of a step
  std::vector<std::int32_t> free_index_;  // per pose: position among the free ones, or -1
  std::vector<std::int32_t> free_pose_;   // the other way
  std::vector<SchurPoint> points_;
  std::span<const std::uint8_t> active_;   // per observation
  std::vector<std::int32_t> order_;        // of the active ones of each point from its first place
                                           // on; empty: they are in order
  std::vector<std::int32_t> first_group_;  // per point, of windows
  std::vector<ObservationLanes> groups_;   // of all points of windows
  mutable std::vector<ObservationLanes> packed_;  // of one point of a whole map
  std::vector<std::int32_t> free_;                // of the point worked on
  std::vector<MixedLanes> mixed_;                 // of the point worked on
  std::vector<PoseMatrix> matrices_;

  BlockPattern pattern_;                 // of the reduced system
  std::vector<std::int32_t> use_order_;  // of its blocks, of whole maps
  BlockPlaces places_;
  std::span<Matrix6d> reduced_;  // blocks of the lower triangle, where places_ says
  AlignedVector<Matrix6d> dense_blocks_;
  PageArray<Matrix6d> sparse_blocks_;
  std::vector<PoseSums> sums_;
  AlignedVector<Vector6d> pose_damping_;
  AlignedVector<Vector6d> pose_step_;
  std::vector<PoseStep> lane_steps_;  // the same for lanes; the first is for what is fixed
  std::optional<BlockCholesky> sparse_;
  Eigen::MatrixXd dense_;
  Eigen::VectorXd flat_gradient_;
  AlignedVector<Matrix63> Z_;                // of the point worked on
  std::vector<EliminatedPoint> eliminated_;  // of windows
  std::vector<Rigid3> old_poses_;
  std::span<Eigen::Vector3d> other_points_;  // after a step not taken yet, or before it
  std::vector<Eigen::Vector3d> dense_points_;
  PageArray<Eigen::Vector3d> sparse_points_;
};

}  // namespace

BundleRoundSummary solve_bundle_schur(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round) {
  return SchurBundle(problem, options, round).solve(round.iterations);
}

}  // namespace kys_slam
