// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_graph.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "geometry/levenberg.h"
#include "geometry/so3.h"
#include "optimization/block_cholesky.h"

namespace kys_slam {

void describe(kys::OptionList& list, PoseGraphOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("pose_graph.iterations", o.iterations, {0, 1000});
}
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Small, as a bend of the whole way costs next to nothing in any single edge: more damping than
// this holds a long loop open.
constexpr double kInitialDamping = 1e-8;
constexpr double kTolerance = 1e-9;  // of the cost

void check(const std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
           const std::vector<PoseGraphEdge>& edges) {
  if (fixed.size() != T_w_c.size()) {
    throw std::invalid_argument("optimize_pose_graph: fixed and T_w_c differ in length");
  }
  if (!T_w_c.empty() &&
      std::count(fixed.begin(), fixed.end(), 0) == static_cast<std::ptrdiff_t>(fixed.size())) {
    throw std::invalid_argument("optimize_pose_graph: at least one pose has to be fixed");
  }
  const auto poses = static_cast<std::int64_t>(T_w_c.size());
  for (const PoseGraphEdge& edge : edges) {
    if (edge.a < 0 || edge.a >= poses || edge.b < 0 || edge.b >= poses || edge.a == edge.b) {
      throw std::invalid_argument("optimize_pose_graph: edge between poses out of range");
    }
  }
}

/// Edges that say nothing usable are left out rather than poison the rest.
bool is_usable(const PoseGraphEdge& edge, const std::vector<Rigid3>& T_w_c) {
  return edge.T_a_b.is_finite() && std::isfinite(edge.weight) && edge.weight > 0 &&
         T_w_c[edge.a].is_finite() && T_w_c[edge.b].is_finite();
}

/// Residual of an edge, and its derivatives by the increments (plus()) of T_w_a and T_w_b.
struct EdgeTerms {
  Vector6d residual;
  Matrix6d J_a;
  Matrix6d J_b;
};

Vector6d edge_residual(const PoseGraphEdge& edge, const Rigid3& T_w_a, const Rigid3& T_w_b) {
  const Rigid3 error = edge.T_a_b.inverse() * (T_w_a.inverse() * T_w_b);
  Vector6d residual;
  residual << edge.weight * so3_log(error.rotation), edge.weight * error.translation;
  return residual;
}

EdgeTerms linearise(const PoseGraphEdge& edge, const Rigid3& T_w_a, const Rigid3& T_w_b) {
  EdgeTerms terms;
  terms.residual = edge_residual(edge, T_w_a, T_w_b);
  // A turn of b by exp(d) on the left is a turn of the error by exp(R_w_b^T d) on its right.
  const Eigen::Vector3d turned = terms.residual.head<3>() / edge.weight;
  const Eigen::Matrix3d J_turn =
      edge.weight * so3_left_jacobian_inverse(turned).transpose() * T_w_b.R().transpose();
  const Eigen::Matrix3d R_b_w =
      edge.weight * (T_w_a.rotation * edge.T_a_b.rotation).conjugate().toRotationMatrix();
  terms.J_a << -J_turn, Eigen::Matrix3d::Zero(), R_b_w * hat(T_w_b.t() - T_w_a.t()), -R_b_w;
  terms.J_b << J_turn, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(), R_b_w;
  return terms;
}

/// Levenberg-Marquardt over the free poses that have edges.
class PoseGraph {
 public:
  PoseGraph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
            const std::vector<PoseGraphEdge>& edges)
      : T_w_c_(T_w_c), free_index_(T_w_c.size(), -1) {
    for (const PoseGraphEdge& edge : edges) {
      if (!is_usable(edge, T_w_c) || (fixed[edge.a] != 0 && fixed[edge.b] != 0)) continue;
      edges_.push_back(edge);
      for (const std::int32_t pose : {edge.a, edge.b}) {
        if (fixed[pose] == 0) free_index_[pose] = 0;
      }
    }
    for (std::size_t i = 0; i < free_index_.size(); ++i) {
      if (free_index_[i] < 0) continue;
      free_index_[i] = static_cast<std::int32_t>(free_pose_.size());
      free_pose_.push_back(static_cast<std::int32_t>(i));
    }
    find_blocks();
    cholesky_.emplace(pattern_);
  }

  void solve(const PoseGraphOptions& options) {
    if (edges_.empty()) return;
    stop_ = options.stop;
    const LevenbergOptions levenberg_options{options.iterations, kTolerance, false, options.stop};
    levenberg(*this, Damping(kInitialDamping), levenberg_options);
  }

  // What levenberg() calls.

  /// 1/2 sum of the squared residuals.
  [[nodiscard]] double cost() const {
    double sum = 0;
    for (const PoseGraphEdge& edge : edges_) {
      sum += edge_residual(edge, T_w_c_[edge.a], T_w_c_[edge.b]).squaredNorm();
    }
    return 0.5 * sum;
  }
  [[nodiscard]] double cost_of_step() const { return cost(); }

  LevenbergStep step(double damping) {
    using Outcome = LevenbergStep::Outcome;
    build(damping);
    const auto result = cholesky_->factorise(blocks_, stop_);
    if (result == BlockCholesky::Result::kStopped) return {Outcome::kStopped};
    if (result != BlockCholesky::Result::kDone) return {Outcome::kNone};
    step_ = -gradient_;
    cholesky_->solve(step_);
    const double predicted = 0.5 * (step_.dot(damping_.cwiseProduct(step_)) - step_.dot(gradient_));
    if (!std::isfinite(predicted) || predicted < 0) return {Outcome::kNone};
    move();
    return {Outcome::kTaken, predicted};
  }

  void accept() {}

  void restore() {
    for (std::size_t r = 0; r < before_.size(); ++r) T_w_c_[free_pose_[r]] = before_[r];
  }

 private:
  /// Blocks of the lower triangle, and of every edge its block off the diagonal.
  void find_blocks() {
    std::vector<std::vector<std::int32_t>> columns(free_pose_.size());
    for (std::size_t r = 0; r < columns.size(); ++r) {
      columns[r].push_back(static_cast<std::int32_t>(r));
    }
    for (const PoseGraphEdge& edge : edges_) {
      const auto [c, r] = std::minmax(free_index_[edge.a], free_index_[edge.b]);
      if (c >= 0) columns[r].push_back(c);
    }
    for (auto& row : columns) {
      std::sort(row.begin(), row.end());
      row.erase(std::unique(row.begin(), row.end()), row.end());
      pattern_.column.insert(pattern_.column.end(), row.begin(), row.end());
      pattern_.row_begin.push_back(static_cast<std::int32_t>(pattern_.column.size()));
    }
    for (const PoseGraphEdge& edge : edges_) {
      const auto [c, r] = std::minmax(free_index_[edge.a], free_index_[edge.b]);
      const auto row = pattern_.column.begin() + pattern_.row_begin[r];
      const auto end = pattern_.column.begin() + pattern_.row_begin[r + 1];
      edge_block_.push_back(c < 0 ? -1
                                  : static_cast<std::int32_t>(std::lower_bound(row, end, c) -
                                                              pattern_.column.begin()));
    }
    blocks_.resize(pattern_.column.size());
    const auto size = static_cast<Eigen::Index>(6 * free_pose_.size());
    gradient_.resize(size);
    damping_.resize(size);
    step_.resize(size);
  }

  /// The normal equations at the present poses.
  void build(double damping) {
    for (Matrix6d& m : blocks_) m.setZero();
    gradient_.setZero();
    for (std::size_t k = 0; k < edges_.size(); ++k) {
      const PoseGraphEdge& edge = edges_[k];
      const EdgeTerms terms = linearise(edge, T_w_c_[edge.a], T_w_c_[edge.b]);
      const std::int32_t a = free_index_[edge.a];
      const std::int32_t b = free_index_[edge.b];
      if (a >= 0) add_own(a, terms.J_a, terms.residual);
      if (b >= 0) add_own(b, terms.J_b, terms.residual);
      if (a < 0 || b < 0) continue;
      Matrix6d& shared = blocks_[edge_block_[k]];
      if (a > b) {
        shared.noalias() += terms.J_a.transpose() * terms.J_b;
      } else {
        shared.noalias() += terms.J_b.transpose() * terms.J_a;
      }
    }
    for (std::int32_t r = 0; r < pattern_.rows(); ++r) {
      Matrix6d& own = blocks_[pattern_.row_begin[r + 1] - 1];
      damping_.segment<6>(6 * r) = damping * own.diagonal().cwiseMax(Damping::kMinDiagonal);
      own.diagonal() += damping_.segment<6>(6 * r);
    }
  }

  void add_own(std::int32_t free, const Matrix6d& J, const Vector6d& residual) {
    blocks_[pattern_.row_begin[free + 1] - 1].noalias() += J.transpose() * J;
    gradient_.segment<6>(6 * free).noalias() += J.transpose() * residual;
  }

  void move() {
    before_.clear();
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      Rigid3& T = T_w_c_[free_pose_[r]];
      before_.push_back(T);
      T = plus(T, step_.segment<6>(static_cast<Eigen::Index>(6 * r)));
    }
  }

  std::vector<Rigid3>& T_w_c_;
  std::vector<std::int32_t> free_index_;  // per pose: position among the free ones, or -1
  std::vector<std::int32_t> free_pose_;   // the other way
  std::vector<PoseGraphEdge> edges_;      // usable ones
  std::vector<std::int32_t> edge_block_;  // -1: one end is fixed
  BlockPattern pattern_;
  std::optional<BlockCholesky> cholesky_;
  const std::atomic<bool>* stop_ = nullptr;
  BlockCholesky::Blocks blocks_;
  Eigen::VectorXd gradient_;
  Eigen::VectorXd damping_;  // what was added to the diagonal
  Eigen::VectorXd step_;
  std::vector<Rigid3> before_;
};

}  // namespace

void optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                         const std::vector<PoseGraphEdge>& edges, const PoseGraphOptions& options) {
  check(T_w_c, fixed, edges);
  PoseGraph(T_w_c, fixed, edges).solve(options);
}

}  // namespace kys_slam
