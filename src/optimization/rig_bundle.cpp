// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_bundle.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "geometry/levenberg.h"
#include "geometry/reprojection.h"
#include "geometry/so3.h"
#include "optimization/eliminated_point.h"
#include "optimization/rig_kernels.h"
#include "optimization/rig_residuals.h"

namespace kys_slam {

namespace {

constexpr int kAll = RigCorrection::kSize;
constexpr int kRounds = 3;
constexpr int kIterations = 10;  // of each round
constexpr double kTolerance = 1e-5;
constexpr double kInitialDamping = 1e-4;
// Square of Huber's delta: errors are about half of what the assumed deviations allow, and this
// bends for the few per cent at depth edges, whose disparities lean towards the nearer surface.
constexpr double kHuber = 0.5;
constexpr double kFarOff = 25;  // chi2 beyond which an observation is left out of a round
// Step of the parameters that ends a round: standard deviations, by the assumed noise, in the
// direction in which it has most. The cost may still fall, by points of a few observations.
constexpr double kSmallStep = 0.03;
constexpr double kPointDamping = 1e-6;
// Variance of an estimate over that with independent residuals: a patch that is seen in several
// keyframes repeats its error. With 1, errors of disparities and rows on rendered worlds (tuning
// seeds 11 and 12) are 0.8 to 2.1 times their sigmas.
constexpr double kRepeats = 2.5;

using Parameters = RigCorrection::Parameters;

double huber(double chi2) {
  return chi2 <= kHuber ? chi2 : 2 * std::sqrt(kHuber * chi2) - kHuber;
}
double huber_weight(double chi2) {
  return chi2 <= kHuber ? 1 : std::sqrt(kHuber / chi2);
}

/// \tparam kRig number of parameters that are free
template <int kRig>
class RigBundle {
 public:
  /// \param free_parameters their numbers
  RigBundle(RigProblem& problem, const std::vector<int>& free_parameters,
            const std::atomic<bool>* stop)
      : p_(problem),
        parameters_(free_parameters),
        stop_(stop),
        residuals_(problem),
        before_{.T_c_w = {}, .points = {}, .residuals = RigResiduals(problem), .x = {}, .rig = {}} {
    for (std::size_t k = 0; k < p_.T_c_w.size(); ++k) {
      place_.push_back(p_.pose_fixed[k] != 0 ? -1 : 6 * free_++);
    }
    RigMatrix covariance;
    for (int r = 0; r < kRig; ++r) {
      for (int c = 0; c < kRig; ++c) {
        covariance(r, c) = p_.prior.covariance(parameters_[r], parameters_[c]);
      }
      x_[r] =
          p_.rig.parameters()[parameters_[r]] - p_.prior.correction.parameters()[parameters_[r]];
    }
    prior_information_ = covariance.llt().solve(RigMatrix::Identity());
    update_rig();
    const int size = 6 * free_ + kRig;
    H_.resize(size, size);
    b_.resize(size);
    H_rig_.resize(std::size_t{kPadded} * kPadded);
    H_mixed_.resize(std::size_t{6} * kPadded * static_cast<std::size_t>(free_));
    b_rig_.resize(kPadded);
  }

  RigSummary solve() {
    RigSummary summary;
    for (int round = 0; round < kRounds && !summary.stopped; ++round) {
      choose();
      minimise(summary);
    }
    summary.observations = static_cast<int>(std::count(active_.begin(), active_.end(), 1));
    if (!summary.stopped) finish(summary);
    return summary;
  }

  // What levenberg() calls.

  [[nodiscard]] double cost() const {
    double sum = x_.dot(prior_information_ * x_);
    for_each([&](std::size_t k, std::size_t i) {
      if (active_[i] == 0) return;
      const RigResidual r = residuals_.at(i, p_.points[k]);
      sum += huber(r.chi2()) + huber(r.row_chi2());
    });
    return 0.5 * sum;
  }

  LevenbergStep step(double damping) {
    LevenbergStep step{LevenbergStep::Outcome::kNone};
    if (!solve(damping, step.last)) return step;
    before_ = {p_.T_c_w, p_.points, residuals_, x_, p_.rig};
    move();
    step.outcome = LevenbergStep::Outcome::kTaken;
    return step;
  }

  double cost_of_step() {
    move_points();
    return cost();
  }

  void accept() {}

  void restore() {
    std::swap(p_.T_c_w, before_.T_c_w);
    std::swap(p_.points, before_.points);
    std::swap(residuals_, before_.residuals);
    x_ = before_.x;
    p_.rig = before_.rig;
  }

 private:
  using RigMatrix = Eigen::Matrix<double, kRig, kRig>;
  using RigVector = Eigen::Matrix<double, kRig, 1>;
  using PoseRows = Eigen::Matrix<double, 3, 6, Eigen::RowMajor>;
  static constexpr int kPadded = rig::padded(kRig);
  static constexpr int kRigLanes = kPadded / kLanes;

  /// What a step changes.
  struct State {
    std::vector<Rigid3> T_c_w;
    std::vector<Eigen::Vector3d> points;
    RigResiduals residuals;
    RigVector x;
    RigCorrection rig;
  };

  template <typename F>
  void for_each(F&& f) const {
    for (std::size_t k = 0; k < p_.points.size(); ++k) {
      for (auto i = static_cast<std::size_t>(p_.first[k]);
           i < static_cast<std::size_t>(p_.first[k + 1]); ++i) {
        f(k, i);
      }
    }
  }

  /// Calls f(number) for the active observations of a point.
  template <typename F>
  void for_observations(std::size_t k, F&& f) const {
    for (auto i = static_cast<std::size_t>(p_.first[k]);
         i < static_cast<std::size_t>(p_.first[k + 1]); ++i) {
      if (active_[i] != 0) f(i);
    }
  }

  /// Leaves out what is far off, or behind the camera.
  void choose() {
    active_.assign(p_.observations.size(), 0);
    for_each([&](std::size_t k, std::size_t i) {
      const RigResidual r = residuals_.at(i, p_.points[k]);
      active_[i] = r.p_c.z() > kMinDepth && r.chi2() < kFarOff ? 1 : 0;
    });
  }

  /// One observation, but for its rows of the Jacobian by the parameters.
  struct Linear {
    Eigen::Matrix<double, 3, 6> J_pose;   // by the increment of plus_left
    Eigen::Matrix<double, 3, 3> J_point;  // by p_w
    Eigen::Vector3d e, w;                 // residual and weights
  };

  /// Rows of the Jacobian by the parameters, with their weights and residuals.
  struct Rows {
    std::vector<double> J, weighted;  // kPadded per row
    std::vector<double> e;

    void clear() {
      J.clear();
      weighted.clear();
      e.clear();
    }
    template <typename Row>
    void add(const Row& row, double weight, double residual) {
      for (int k = 0; k < kPadded; ++k) {
        const double value = k < kRig ? row[k] : 0;
        J.push_back(value);
        weighted.push_back(weight * value);
      }
      e.push_back(residual);
    }
    [[nodiscard]] std::size_t size() const { return e.size(); }
  };

  void linearise_observation(std::size_t i, const Eigen::Vector3d& p_w) {
    const RigProblem::Observation& o = p_.observations[i];
    const RigResidual r = residuals_.at(i, p_w);
    const Eigen::Matrix<double, 4, kRig> J = free_columns(residuals_.jacobian(i, r));
    Linear l;
    places_.push_back(place_[o.pose]);
    const Eigen::Matrix3d J_c = r.scale.asDiagonal() * reprojection_jacobian(p_.camera, r.p_c);
    l.J_pose << -J_c * hat(r.p_c), J_c;
    l.J_point = J_c * p_.T_c_w[o.pose].R();
    l.e = r.e.head<3>();
    l.w = huber_weight(r.chi2()) * r.information.head<3>();
    for (int row = 0; row < 3; ++row) {
      rows_.add(J.row(row), l.w[row], l.e[row]);
    }
    linear_.push_back(l);
    if (r.has_row()) {
      epipolar_.add(J.row(3), huber_weight(r.row_chi2()) * r.information[3], r.e[3]);
    }
  }

  /// Adds to the block of the parameters, and to their right-hand side.
  void add(const Rows& rows) {
    rig::add_squares(rows.J.data(), rows.weighted.data(), rows.size(), kRigLanes, H_rig_.data());
    rig::add_rows(rows.weighted.data(), rows.e.data(), rows.size(), kRigLanes, b_rig_.data());
  }

  /// Adds the normal equations of a point, which is eliminated.
  void eliminate(std::size_t k, double damping) {
    const Eigen::Vector3d& p_w = p_.points[k];
    linear_.clear();
    places_.clear();
    rows_.clear();
    epipolar_.clear();
    for_observations(k, [&](std::size_t i) { linearise_observation(i, p_w); });
    add(epipolar_);
    if (linear_.size() < 2) return;
    add(rows_);
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (const Linear& l : linear_) {
      V.noalias() += l.J_point.transpose() * l.w.asDiagonal() * l.J_point;
      g.noalias() += l.J_point.transpose() * l.w.cwiseProduct(l.e);
    }
    V.diagonal() += (damping * V.diagonal().array() + kPointDamping).matrix();
    const Eigen::Matrix3d L_inverse = inverse_of_cholesky(V);
    const Eigen::Vector3d y = L_inverse * g;
    // What is left of every unknown after the point: Z = L^-1 J_point^T W J.
    Z_.resize(linear_.size());
    std::array<double, std::size_t{3} * kPadded> Z_rig{}, minus{};
    for (std::size_t a = 0; a < linear_.size(); ++a) {
      const Linear& l = linear_[a];
      const Eigen::Matrix3d half = L_inverse * l.J_point.transpose() * l.w.asDiagonal();
      Z_[a] = half * l.J_pose;
      for (int r = 0; r < 3; ++r) {
        const Eigen::Vector3d factors = half.row(r);
        rig::add_rows(rows_.J.data() + 3 * kPadded * a, factors.data(), 3, kRigLanes,
                      Z_rig.data() + std::ptrdiff_t{kPadded} * r);
      }
    }
    for (std::size_t n = 0; n < Z_rig.size(); ++n) minus[n] = -Z_rig[n];
    rig::add_squares(Z_rig.data(), minus.data(), 3, kRigLanes, H_rig_.data());
    rig::add_rows(minus.data(), y.data(), 3, kRigLanes, b_rig_.data());
    for (std::size_t a = 0; a < linear_.size(); ++a) add_pose(a, y, minus.data());
    rig::subtract_pairs(places_.data(), Z_.front().data(), Z_.size(), H_.rows(), H_.data());
  }

  /// Adds what one pose has to do with itself, the parameters and the right-hand side.
  /// \param minus_Z_rig 3 rows
  void add_pose(std::size_t a, const Eigen::Vector3d& y, const double* minus_Z_rig) {
    const Linear& l = linear_[a];
    const std::int32_t place = places_[a];
    if (place < 0) return;
    H_.block<6, 6>(place, place).noalias() += l.J_pose.transpose() * l.w.asDiagonal() * l.J_pose;
    b_.segment<6>(place).noalias() +=
        l.J_pose.transpose() * l.w.cwiseProduct(l.e) - Z_[a].transpose() * y;
    double* mixed = H_mixed_.data() + std::ptrdiff_t{kPadded} * place;
    const PoseRows J = l.J_pose;
    rig::add_products(rows_.weighted.data() + 3 * kPadded * a, J.data(), 3, kRigLanes, mixed);
    rig::add_products(minus_Z_rig, Z_[a].data(), 3, kRigLanes, mixed);
  }

  /// The normal equations without the points, lower triangle.
  void linearise(double damping) {
    H_.setZero();
    b_.setZero();
    H_rig_.assign(H_rig_.size(), 0);
    H_mixed_.assign(H_mixed_.size(), 0);
    b_rig_.assign(b_rig_.size(), 0);
    for (std::size_t k = 0; k < p_.points.size(); ++k) eliminate(k, damping);
    using Padded = Eigen::Matrix<double, kPadded, Eigen::Dynamic>;
    const auto rig = static_cast<Eigen::Index>(6 * free_);
    H_.template block<kRig, kRig>(rig, rig) =
        Eigen::Map<const Padded>(H_rig_.data(), kPadded, kRig).template topRows<kRig>() +
        prior_information_;
    H_.bottomLeftCorner(kRig, rig) =
        Eigen::Map<const Padded>(H_mixed_.data(), kPadded, rig).template topRows<kRig>();
    b_.template segment<kRig>(rig) =
        Eigen::Map<const RigVector>(b_rig_.data()) + prior_information_ * x_;
  }

  /// Solves for a step of all unknowns; false when the equations have no solution.
  /// \param last set to whether the step of the parameters is small against what they are known to
  bool solve(double damping, bool& last) {
    linearise(damping);
    H_.diagonal() += damping * H_.diagonal().cwiseMax(Damping::kMinDiagonal);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(H_);
    if (factor.info() != Eigen::Success) return false;
    step_ = factor.solve(-b_);
    // The parameters come last, so that the factor's last block is that of their information alone.
    const RigVector deviations = H_.template bottomRightCorner<kRig, kRig>()
                                     .template triangularView<Eigen::Lower>()
                                     .transpose() *
                                 step_.template tail<kRig>();
    last = deviations.norm() < kSmallStep;
    return step_.allFinite();
  }

  void move() {
    for (std::size_t k = 0; k < place_.size(); ++k) {
      if (place_[k] < 0) continue;
      p_.T_c_w[k] = plus_left(p_.T_c_w[k], step_.segment<6>(place_[k]));
    }
    x_ += step_.template tail<kRig>();
    update_rig();
  }

  void update_rig() {
    Parameters parameters = p_.prior.correction.parameters();
    for (int k = 0; k < kRig; ++k) parameters[parameters_[k]] += x_[k];
    p_.rig = RigCorrection(p_.camera, parameters);
    residuals_.update();
  }

  [[nodiscard]] Eigen::Matrix<double, 4, kRig> free_columns(
      const RigCorrection::Jacobian& J) const {
    Eigen::Matrix<double, 4, kRig> chosen;
    for (int k = 0; k < kRig; ++k) chosen.col(k) = J.col(parameters_[k]);
    return chosen;
  }

  [[nodiscard]] double point_cost(std::size_t k, const Eigen::Vector3d& p_w) const {
    double sum = 0;
    for_observations(k, [&](std::size_t i) { sum += huber(residuals_.at(i, p_w).chi2()); });
    return sum;
  }

  /// Every point alone to its best place, poses and rig held (embedded point iterations, Jeong et
  /// al., 2012).
  void move_points() {
    constexpr int kTurns = 3;
    for (std::size_t k = 0; k < p_.points.size(); ++k) {
      double before = point_cost(k, p_.points[k]);
      for (int turn = 0; turn < kTurns; ++turn) {
        Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
        Eigen::Vector3d g = Eigen::Vector3d::Zero();
        for_observations(k, [&](std::size_t i) {
          const RigResidual r = residuals_.at(i, p_.points[k]);
          const Eigen::Matrix3d J = r.scale.asDiagonal() * reprojection_jacobian(p_.camera, r.p_c) *
                                    p_.T_c_w[p_.observations[i].pose].R();
          const Eigen::Vector3d w = huber_weight(r.chi2()) * r.information.head<3>();
          V.noalias() += J.transpose() * w.asDiagonal() * J;
          g.noalias() += J.transpose() * w.cwiseProduct(r.e.head<3>());
        });
        V.diagonal() += (1e-4 * V.diagonal().array() + kPointDamping).matrix();
        const Eigen::Vector3d moved = p_.points[k] - V.llt().solve(g);
        const double after = point_cost(k, moved);
        if (!(after < before)) break;
        p_.points[k] = moved;
        if (before - after < 1e-3 * before) break;
        before = after;
      }
    }
  }

  void minimise(RigSummary& summary) {
    const LevenbergOptions options{kIterations, kTolerance, false, stop_};
    const LevenbergSummary s = levenberg(*this, Damping(kInitialDamping), options);
    if (summary.iterations == 0) summary.initial_cost = s.initial_cost;
    summary.final_cost = s.final_cost;
    summary.iterations += s.iterations;
    summary.stopped = s.stopped;
  }

  void finish(RigSummary& summary) {
    linearise(0);
    const auto rig = static_cast<Eigen::Index>(6 * free_);
    // Of the parameters alone: the poses are eliminated too.
    Eigen::MatrixXd poses = H_.topLeftCorner(rig, rig);
    poses.diagonal().array() += Damping::kMinDiagonal;
    const Eigen::MatrixXd mixed = H_.bottomLeftCorner(kRig, rig);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(poses);
    RigMatrix left = H_.bottomRightCorner(kRig, kRig);
    left = RigMatrix(left.template selfadjointView<Eigen::Lower>());
    // By columns: Eigen splits the sums of several at once by the size of the processor's cache.
    for (Eigen::Index i = 0; i < kRig; ++i) {
      const Eigen::VectorXd column = mixed.row(i).transpose();
      left.col(i) -= mixed * factor.solve(column);
    }
    int residuals = 0;
    double sum = 0;
    for_each([&](std::size_t k, std::size_t i) {
      if (active_[i] == 0) return;
      const RigResidual r = residuals_.at(i, p_.points[k]);
      residuals += r.has_disparity() ? 3 : 2;
      sum += huber(r.chi2());
    });
    const int unknowns = static_cast<int>(6 * free_ + 3 * static_cast<int>(p_.points.size()));
    summary.unit = std::sqrt(sum / std::max(1, residuals - unknowns));
    // The prior is as it is; what was measured is as good as its residuals, and repeats.
    const double variance = kRepeats * summary.unit * summary.unit;
    const RigMatrix information = (left - prior_information_) / variance + prior_information_;
    const RigMatrix covariance = information.llt().solve(RigMatrix::Identity());
    for (int r = 0; r < kRig; ++r) {
      for (int c = 0; c < kRig; ++c) {
        summary.covariance(parameters_[r], parameters_[c]) = covariance(r, c);
      }
    }
  }

  RigProblem& p_;
  std::vector<int> parameters_;  // numbers of the free ones
  const std::atomic<bool>* stop_;
  std::vector<std::int32_t> place_;  // per pose: its first unknown, -1: fixed
  int free_ = 0;
  RigMatrix prior_information_;
  RigVector x_;  // free parameters less those of the prior
  RigResiduals residuals_;
  State before_;  // the step
  std::vector<std::uint8_t> active_;
  // Of the point worked on: its observations, their rows, and those of rows in the right image.
  std::vector<Linear> linear_;
  Rows rows_, epipolar_;
  std::vector<PoseRows> Z_;
  std::vector<std::int32_t> places_;  // of the poses of the point's observations
  Eigen::MatrixXd H_;
  Eigen::VectorXd b_, step_;
  // Blocks of H_ and b_ while they are summed up, columns padded: parameters by parameters, lower
  // triangle, and by poses.
  std::vector<double> H_rig_, H_mixed_, b_rig_;
};

}  // namespace

RigSummary adjust_rig(RigProblem& problem, const std::atomic<bool>* stop) {
  std::vector<int> free;
  for (int k = 0; k < kAll; ++k) {
    if (problem.prior.covariance(k, k) > 0) free.push_back(k);
  }
  if (free.size() == 1) return RigBundle<1>(problem, free, stop).solve();
  if (free.size() == kAll) return RigBundle<kAll>(problem, free, stop).solve();
  throw std::invalid_argument("adjust_rig: one parameter is free, or all are");
}

}  // namespace kys_slam
