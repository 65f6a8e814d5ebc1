#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "geometry/reprojection.h"
#include "optimization/block_cholesky.h"
#include "optimization/bundle_solver.h"
#include "util/lanes.h"

// Levenberg-Marquardt on the normal equations of bundle adjustment with the points eliminated
// (Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 6.1). The reduced system is dense
// for windows of few poses and sparse, by blocks, for whole maps; what comes before it is the same.
// The increment of a pose is that of the camera frame, p_c -> exp(w) p_c + v, which has the
// sparsest Jacobian. A point's blocks never leave the cache: its observations are linearised and
// eliminated in one go, and only what back-substitution needs is kept.

namespace kys_slam {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;

constexpr double kInitialDamping = 1e-4;
constexpr double kMinDiagonal = 1e-6;  // as Ceres: damping where a direction is not observed at all
constexpr double kMaxDamping = 1e16;
constexpr std::size_t kPointsBetweenStops = 4096;  // some ms
constexpr int kPointRounds = 2;
constexpr double kPointDamping = 1e-3;

struct SchurObservation {
  std::int32_t pose;     // index of the pose
  std::int32_t free;     // position among the free poses, -1: fixed
  double u, v, u_right;  // px; u_right 0 for monocular
  double weight;         // 1/px^2
  double weight_right;   // 1/px^2, 0 for monocular
  double bound;          // square of Huber's delta
};

/// One point and its observations [begin, end) in the sorted array.
struct SchurPoint {
  std::int32_t point;
  std::int32_t begin;
  std::int32_t end;
};

/// What back-substitution and the gain ratio need of an eliminated point.
struct EliminatedPoint {
  Eigen::Matrix3d L_inverse;  // of the Cholesky factor of V + damping
  Eigen::Vector3d y;          // L^-1 b
  Eigen::Vector3d b;          // J^T W r
  Eigen::Vector3d damping;    // what was added to the diagonal of V
};

struct PoseMatrix {
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
};

/// Where the blocks of the lower triangle of the reduced system are, row by row: all of them, or
/// those of poses that share a point.
class BlockPlaces {
 public:
  BlockPlaces() = default;
  explicit BlockPlaces(const BlockPattern& pattern)
      : first_(pattern.rows()), begin_(pattern.rows()) {
    for (std::int32_t r = 0; r < pattern.rows(); ++r) {
      // From the row's first block to the diagonal, gaps included.
      const std::int32_t* column = pattern.column.data();
      first_[r] = column[pattern.row_begin[r]];
      begin_[r] = place_.size();
      place_.resize(place_.size() + static_cast<std::size_t>(r - first_[r]) + 1, -1);
      for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
        place_[begin_[r] + static_cast<std::size_t>(column[k] - first_[r])] = k;
      }
    }
  }
  [[nodiscard]] std::int32_t operator()(std::int32_t row, std::int32_t col) const {
    return place_[begin_[row] + static_cast<std::size_t>(col - first_[row])];
  }

 private:
  std::vector<std::int32_t> first_;
  std::vector<std::size_t> begin_;
  std::vector<std::int32_t> place_;
};

// Columns of six as four and two, wherever they lie in memory.
using Four = double __attribute__((vector_size(32), aligned(8), may_alias));
using Two = double __attribute__((vector_size(16), aligned(8), may_alias));

/// S -= a b^T for column-major 6x3 a, b and 6x6 S.
KYS_ALWAYS_INLINE void subtract_outer(const double* a, const double* b, double* S) {
  const Lanes a0 = *reinterpret_cast<const Four*>(a);
  const Lanes a1 = *reinterpret_cast<const Four*>(a + 6);
  const Lanes a2 = *reinterpret_cast<const Four*>(a + 12);
  const Two t0 = *reinterpret_cast<const Two*>(a + 4);
  const Two t1 = *reinterpret_cast<const Two*>(a + 10);
  const Two t2 = *reinterpret_cast<const Two*>(a + 16);
  for (int col = 0; col < 6; ++col) {
    auto& top = *reinterpret_cast<Four*>(S + 6 * col);
    auto& bottom = *reinterpret_cast<Two*>(S + 6 * col + 4);
    top -= a0 * b[col] + a1 * b[col + 6] + a2 * b[col + 12];
    bottom -= t0 * b[col] + t1 * b[col + 6] + t2 * b[col + 12];
  }
}

/// Takes the products Z_row Z_col^T of one point's observations off the reduced system.
KYS_VECTOR_CLONES void subtract_products(const SchurObservation* observations, const Matrix63* Z,
                                         std::int32_t count, const BlockPlaces& places,
                                         Matrix6d* reduced) {
  for (std::int32_t row = 0; row < count; ++row) {
    const std::int32_t r = observations[row].free;
    for (std::int32_t col = 0; col <= row; ++col) {
      const std::int32_t c = observations[col].free;
      double* S = reduced[places(r, c)].data();
      subtract_outer(Z[row].data(), Z[col].data(), S);
      // A point seen twice from one pose gives that pose's block both triangles.
      if (c == r && col != row) subtract_outer(Z[col].data(), Z[row].data(), S);
    }
  }
}

class SchurBundle {
 public:
  SchurBundle(BundleProblem& problem, const BundleOptions& options, const BundleRound& round)
      : problem_(problem), options_(options), robust_(round.robust) {
    number_free_poses(round);
    sort_observations(round);
    const BlockPattern pattern = round.sparse ? shared_points() : all_blocks();
    places_ = BlockPlaces(pattern);
    if (round.sparse) sparse_.emplace(pattern);
    reduced_.resize(pattern.column.size());
    gradient_.resize(free_pose_.size());
    pose_damping_.resize(free_pose_.size());
    pose_step_.resize(free_pose_.size());
    eliminated_.resize(points_.size());
    point_step_.resize(points_.size());
    Z_.resize(observations_.size());
    const auto size = static_cast<Eigen::Index>(6 * free_pose_.size());
    if (!round.sparse) dense_.resize(size, size);
    flat_gradient_.resize(size);
  }

  BundleRoundSummary solve(int iterations) {
    BundleRoundSummary summary;
    update_matrices();
    double cost = evaluate();
    summary.initial_cost = summary.final_cost = cost;
    if (observations_.empty()) return summary;
    double damping = kInitialDamping;
    double growth = 2;
    while (summary.iterations < iterations && damping < kMaxDamping) {
      if (should_stop()) {
        summary.stopped = true;
        break;
      }
      ++summary.iterations;
      const double predicted = step(damping);
      if (stopped_) {  // nothing has moved
        summary.stopped = true;
        break;
      }
      if (!(predicted >= 0)) {  // no factorisation, or NaN
        damping *= growth;
        growth *= 2;
        continue;
      }
      if (predicted <= 1e-3 * options_.function_tolerance * cost) break;
      if (sparse_) settle_points();
      const double candidate = evaluate();
      const double decrease = cost - candidate;
      const double gain = decrease / predicted;
      if (gain > 1e-3) {
        const bool converged = decrease <= options_.function_tolerance * cost;
        cost = candidate;
        // Nielsen's rule: the better the model held, the less damping.
        damping *= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3));
        growth = 2;
        if (converged) break;
      } else {
        restore();
        if (std::abs(decrease) <= options_.function_tolerance * cost) break;
        damping *= growth;
        growth *= 2;
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
    free_index_.assign(problem_.T_c_w.size(), -1);
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i] == 0 || round.pose_fixed[i] != 0) continue;
      free_index_[i] = static_cast<std::int32_t>(free_pose_.size());
      free_pose_.push_back(static_cast<std::int32_t>(i));
    }
  }

  /// Groups the active observations by point (counting sort) and orders those of a point by free
  /// pose, so that sums run in the same order however the caller listed them per pose.
  void sort_observations(const BundleRound& round) {
    std::vector<std::int32_t> first(problem_.points.size() + 1, 0);
    const auto& all = problem_.observations;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (round.active[i] != 0) ++first[all[i].point + 1];
    }
    for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
    for (std::size_t i = 0; i + 1 < first.size(); ++i) {
      if (first[i + 1] == first[i]) continue;
      points_.push_back({static_cast<std::int32_t>(i), first[i], first[i + 1]});
    }
    observations_.resize(first.back());
    std::vector<std::int32_t> next(first.begin(), first.end() - 1);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (round.active[i] != 0) observations_[next[all[i].point]++] = convert(all[i]);
    }
    for (const SchurPoint& p : points_) {
      const auto begin = observations_.begin() + p.begin;
      const auto end = observations_.begin() + p.end;
      const auto earlier = [](const auto& a, const auto& b) { return a.free < b.free; };
      if (!std::is_sorted(begin, end, earlier)) std::stable_sort(begin, end, earlier);
    }
  }

  [[nodiscard]] BlockPattern all_blocks() const {
    BlockPattern pattern;
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t c = 0; c <= r; ++c) pattern.column.push_back(c);
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  /// Blocks of poses that see a point together.
  [[nodiscard]] BlockPattern shared_points() const {
    // Observations by free pose, so that a row is finished before the next.
    std::vector<std::int32_t> begin(free_pose_.size() + 1, 0);
    for (const SchurObservation& o : observations_) {
      if (o.free >= 0) ++begin[o.free + 1];
    }
    for (std::size_t r = 1; r < begin.size(); ++r) begin[r] += begin[r - 1];
    std::vector<std::int32_t> point_of(static_cast<std::size_t>(begin.back()));
    std::vector<std::int32_t> next(begin.begin(), begin.end() - 1);
    for (std::size_t k = 0; k < points_.size(); ++k) {
      for (std::int32_t i = points_[k].begin; i < points_[k].end; ++i) {
        const std::int32_t r = observations_[i].free;
        if (r >= 0) point_of[next[r]++] = static_cast<std::int32_t>(k);
      }
    }
    BlockPattern pattern;
    std::vector<std::int32_t> seen_by(free_pose_.size(), -1);
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t k = begin[r]; k < begin[r + 1]; ++k) {
        const SchurPoint& point = points_[point_of[k]];
        for (std::int32_t i = point.begin; i < point.end; ++i) {
          const std::int32_t c = observations_[i].free;
          if (c > r) break;
          if (c < 0 || seen_by[c] == r) continue;
          seen_by[c] = r;
          pattern.column.push_back(c);
        }
      }
      std::sort(pattern.column.begin() + pattern.row_begin.back(), pattern.column.end());
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  [[nodiscard]] SchurObservation convert(const BundleProblem::Observation& o) const {
    const bool stereo = !std::isnan(o.u_right);
    // Errors and their bound shrink together: the kernel acts as on the unweighted error.
    const double weight = o.weight * (static_cast<double>(o.inv_sigma) * o.inv_sigma);
    return {o.pose,
            free_index_[o.pose],
            o.u,
            o.v,
            stereo ? o.u_right : 0,
            weight,
            stereo ? weight * options_.disparity_weight : 0,
            o.weight * (stereo ? options_.chi2_stereo : options_.chi2_mono)};
  }

  void update_matrices() {
    matrices_.resize(problem_.T_c_w.size());
    for (std::size_t i = 0; i < matrices_.size(); ++i) {
      matrices_[i] = {problem_.T_c_w[i].R(), problem_.T_c_w[i].translation};
    }
  }

  /// rho of an observation's chi2, the point being at p_w.
  [[nodiscard]] double loss(const SchurObservation& o, const Eigen::Vector3d& p_w) const {
    const PoseMatrix& T = matrices_[o.pose];
    const Eigen::Vector3d p_c = T.R * p_w + T.t;
    const Eigen::Vector3d e = reprojection_error(problem_.camera, p_c, o.u, o.v, o.u_right);
    const double chi2 = o.weight * (e.x() * e.x() + e.y() * e.y()) + o.weight_right * e.z() * e.z();
    return robust_ && chi2 > o.bound ? 2.0 * std::sqrt(chi2 * o.bound) - o.bound : chi2;
  }

  [[nodiscard]] double loss(const SchurPoint& point, const Eigen::Vector3d& p_w) const {
    double sum = 0;
    for (std::int32_t i = point.begin; i < point.end; ++i) sum += loss(observations_[i], p_w);
    return sum;
  }

  /// 1/2 sum of rho at the present poses and points.
  [[nodiscard]] double evaluate() const {
    double cost = 0;
    for (const SchurPoint& point : points_) {
      const Eigen::Vector3d& p_w = problem_.points[point.point];
      for (std::int32_t i = point.begin; i < point.end; ++i) cost += loss(observations_[i], p_w);
    }
    return 0.5 * cost;
  }

  /// After a step, every point by itself goes where the moved poses see it best (Jeong et al.,
  /// "Pushing the envelope of modern methods for bundle adjustment", 2012, Sec. 4: embedded point
  /// iterations). The linear model is poor for the few points of little parallax; without this they
  /// get steps refused that were good for all others.
  void settle_points() {
    for (std::size_t k = 0; k < points_.size(); ++k) {
      if (k % kPointsBetweenStops == 0 && should_stop()) return;
      Eigen::Vector3d& p_w = problem_.points[points_[k].point];
      double cost = loss(points_[k], p_w);
      if (const double before = loss(points_[k], old_points_[k]); before < cost) {
        p_w = old_points_[k];
        cost = before;
      }
      for (int round = 0; round < kPointRounds; ++round) {
        const Eigen::Vector3d moved = p_w + point_newton_step(points_[k], p_w);
        const double after = loss(points_[k], moved);
        if (!(after < cost)) break;
        p_w = moved;
        cost = after;
      }
    }
  }

  /// Gauss-Newton step of one point, the poses held.
  [[nodiscard]] Eigen::Vector3d point_newton_step(const SchurPoint& point,
                                                  const Eigen::Vector3d& p_w) const {
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::int32_t i = point.begin; i < point.end; ++i) {
      const SchurObservation& o = observations_[i];
      const PoseMatrix& T = matrices_[o.pose];
      const Eigen::Vector3d p = T.R * p_w + T.t;
      const Eigen::Vector3d e = reprojection_error(problem_.camera, p, o.u, o.v, o.u_right);
      const double chi2 =
          o.weight * (e.x() * e.x() + e.y() * e.y()) + o.weight_right * e.z() * e.z();
      const double w = robust_ && chi2 > o.bound ? std::sqrt(o.bound / chi2) : 1.0;
      const Eigen::Matrix3d J = reprojection_jacobian(problem_.camera, p) * T.R;
      const Eigen::Vector3d W(w * o.weight, w * o.weight, w * o.weight_right);
      const Eigen::Matrix3d JtW = J.transpose() * W.asDiagonal();
      V.noalias() += JtW * J;
      b.noalias() += JtW * e;
    }
    V.diagonal() += kPointDamping * V.diagonal().cwiseMax(kMinDiagonal);
    const Eigen::Matrix3d L_inverse = inverse_of_cholesky(V);
    return -(L_inverse.transpose() * (L_inverse * b));
  }

  Matrix6d& block(std::int32_t row, std::int32_t col) { return reduced_[places_(row, col)]; }

  /// Linearises and eliminates every point, solves, and moves poses and points. Returns the
  /// decrease of the cost that the linear model predicts, or a negative number or NaN if there is
  /// no such step (nothing has moved then).
  double step(double damping) {
    for (Matrix6d& m : reduced_) m.setZero();
    for (Vector6d& g : gradient_) g.setZero();
    for (Vector6d& d : pose_damping_) d.setZero();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (i % kPointsBetweenStops == 0 && should_stop()) {
        stopped_ = true;
        return -1;
      }
      eliminate(i, damping);
    }
    if (!solve_reduced(damping)) return -1;
    const double predicted = back_substitute();
    if (std::isfinite(predicted) && predicted >= 0) apply();
    return predicted;
  }

  /// Adds a point's observations to the reduced system.
  void eliminate(std::size_t index, double damping) {
    const SchurPoint& point = points_[index];
    const Eigen::Vector3d& p_w = problem_.points[point.point];
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (std::int32_t i = point.begin; i < point.end; ++i) linearise(i, p_w, V, b);

    EliminatedPoint& e = eliminated_[index];
    e.b = b;
    e.damping = damping * V.diagonal().cwiseMax(kMinDiagonal);
    V.diagonal() += e.damping;
    e.L_inverse = inverse_of_cholesky(V);
    e.y = e.L_inverse * b;
    std::int32_t i = point.begin;
    while (i < point.end && observations_[i].free < 0) ++i;
    for (std::int32_t row = i; row < point.end; ++row) {
      Z_[row] = (Z_[row] * e.L_inverse.transpose()).eval();
      gradient_[observations_[row].free].noalias() -= Z_[row] * e.y;
    }
    subtract_products(observations_.data() + i, Z_.data() + i, point.end - i, places_,
                      reduced_.data());
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

  /// Adds one observation to its point's V and b and to its pose's block and gradient, and leaves
  /// its mixed block (pose rows, point columns) in Z_.
  void linearise(std::int32_t index, const Eigen::Vector3d& p_w, Eigen::Matrix3d& V,
                 Eigen::Vector3d& b) {
    const SchurObservation& o = observations_[index];
    const PoseMatrix& T = matrices_[o.pose];
    const Eigen::Vector3d p = T.R * p_w + T.t;
    const Eigen::Vector3d e = reprojection_error(problem_.camera, p, o.u, o.v, o.u_right);
    const double chi2 = o.weight * (e.x() * e.x() + e.y() * e.y()) + o.weight_right * e.z() * e.z();
    const double w = robust_ && chi2 > o.bound ? std::sqrt(o.bound / chi2) : 1.0;

    const Eigen::Matrix3d J = reprojection_jacobian(problem_.camera, p);
    const Eigen::Vector3d W(w * o.weight, w * o.weight, w * o.weight_right);
    const Eigen::Matrix3d JtW = J.transpose() * W.asDiagonal();
    const Eigen::Matrix3d A = JtW * J;
    const Eigen::Vector3d g = JtW * e;
    const Eigen::Matrix3d AR = A * T.R;
    V.noalias() += T.R.transpose() * AR;
    b.noalias() += T.R.transpose() * g;
    if (o.free < 0) return;

    const Eigen::Matrix3d P = hat(p);
    Matrix63& mixed = Z_[index];
    mixed.topRows<3>() = P * AR;
    mixed.bottomRows<3>() = AR;
    const Eigen::Matrix3d PA = P * A;
    Matrix6d& U = block(o.free, o.free);
    Matrix6d add;
    add.topLeftCorner<3, 3>() = -PA * P;
    add.topRightCorner<3, 3>() = PA;
    add.bottomLeftCorner<3, 3>() = PA.transpose();
    add.bottomRightCorner<3, 3>() = A;
    U += add;
    pose_damping_[o.free] += add.diagonal();
    gradient_[o.free].head<3>() += p.cross(g);
    gradient_[o.free].tail<3>() += g;
  }

  /// Solves for the increments of the poses.
  bool solve_reduced(double damping) {
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    if (poses == 0) return true;
    for (std::int32_t r = 0; r < poses; ++r) {
      // The point terms have been taken off already; the damping is that of the full diagonal.
      pose_damping_[r] = damping * pose_damping_[r].cwiseMax(kMinDiagonal);
      block(r, r).diagonal() += pose_damping_[r];
      flat_gradient_.segment<6>(6 * r) = -gradient_[r];
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
    const BlockCholesky::Result result = sparse_->factorise(reduced_, options_.stop);
    stopped_ = result == BlockCholesky::Result::kStopped;
    if (result != BlockCholesky::Result::kDone) return false;
    sparse_->solve(flat_gradient_);
    return true;
  }

  /// Increments of the points, and the decrease predicted for the whole step:
  /// 1/2 (step^T damping step - step^T gradient), with the gradient before elimination.
  double back_substitute() {
    double predicted = 0;
    for (std::size_t r = 0; r < pose_step_.size(); ++r) {
      predicted += pose_step_[r].dot(pose_damping_[r].cwiseProduct(pose_step_[r]));
      predicted -= pose_step_[r].dot(gradient_[r]);  // reduced: the point part is added below
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const EliminatedPoint& e = eliminated_[k];
      Eigen::Vector3d moved = Eigen::Vector3d::Zero();  // sum of Z^T pose_step
      for (std::int32_t i = points_[k].begin; i < points_[k].end; ++i) {
        const std::int32_t r = observations_[i].free;
        if (r >= 0) moved.noalias() += Z_[i].transpose() * pose_step_[r];
      }
      point_step_[k] = -(e.L_inverse.transpose() * (e.y + moved));
      predicted += point_step_[k].dot(e.damping.cwiseProduct(point_step_[k]));
      predicted -= point_step_[k].dot(e.b) + moved.dot(e.y);
    }
    return 0.5 * predicted;
  }

  void apply() {
    old_poses_.clear();
    old_points_.clear();
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      Rigid3& T = problem_.T_c_w[free_pose_[r]];
      old_poses_.push_back(T);
      const Eigen::Quaterniond turn = so3_exp(pose_step_[r].head<3>());
      T = {turn * T.rotation, turn * T.translation + pose_step_[r].tail<3>()};
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      Eigen::Vector3d& p_w = problem_.points[points_[k].point];
      old_points_.push_back(p_w);
      p_w += point_step_[k];
    }
    update_matrices();
  }

  void restore() {
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      problem_.T_c_w[free_pose_[r]] = old_poses_[r];
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      problem_.points[points_[k].point] = old_points_[k];
    }
    update_matrices();
  }

  template <typename T>
  using AlignedVector = std::vector<T, Eigen::aligned_allocator<T>>;

  BundleProblem& problem_;
  const BundleOptions& options_;
  const bool robust_;
  bool stopped_ = false;                  // in the middle of a step
  std::vector<std::int32_t> free_index_;  // per pose: position among the free ones, or -1
  std::vector<std::int32_t> free_pose_;   // the other way
  std::vector<SchurPoint> points_;
  std::vector<SchurObservation> observations_;
  std::vector<PoseMatrix> matrices_;

  BlockPlaces places_;
  AlignedVector<Matrix6d> reduced_;  // blocks of the lower triangle, row by row
  AlignedVector<Vector6d> gradient_;
  AlignedVector<Vector6d> pose_damping_;
  AlignedVector<Vector6d> pose_step_;
  std::optional<BlockCholesky> sparse_;
  Eigen::MatrixXd dense_;
  Eigen::VectorXd flat_gradient_;
  AlignedVector<Matrix63> Z_;
  std::vector<EliminatedPoint> eliminated_;
  std::vector<Eigen::Vector3d> point_step_;
  std::vector<Rigid3> old_poses_;
  std::vector<Eigen::Vector3d> old_points_;
};

}  // namespace

BundleRoundSummary solve_bundle_schur(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round) {
  return SchurBundle(problem, options, round).solve(round.iterations);
}

}  // namespace kys_slam
