// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_bundle.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "geometry/levenberg.h"
#include "geometry/reprojection.h"
#include "geometry/so3.h"

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
constexpr double kFarOff = 25;      // chi2 beyond which an observation is left out of a round
constexpr double kRowSigma = 0.25;  // px of the octave
constexpr double kPointDamping = 1e-6;
// Variance of an estimate over that with independent residuals: a patch that is seen in several
// keyframes repeats its error. With 1, errors of disparities and rows on rendered worlds (tuning
// seeds 11 and 12) are 0.8 to 2.1 times their sigmas.
constexpr double kRepeats = 2.5;

using Parameters = RigCorrection::Parameters;
using RigJacobian = RigCorrection::Jacobian;

struct Residual {
  // u, v, disparity, row; px of the images as measured. In px of the perfect pair residuals would
  // be smaller the more the correction shrinks the images, which would bias it.
  Eigen::Vector4d e = Eigen::Vector4d::Zero();
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();  // measured over ideal
  Eigen::Vector4d information = Eigen::Vector4d::Zero();
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();

  [[nodiscard]] double chi2() const { return e.head<3>().cwiseAbs2().dot(information.head<3>()); }
  [[nodiscard]] double row_chi2() const { return e[3] * e[3] * information[3]; }
};

double huber(double chi2) {
  return chi2 <= kHuber ? chi2 : 2 * std::sqrt(kHuber * chi2) - kHuber;
}
double huber_weight(double chi2) {
  return chi2 <= kHuber ? 1 : std::sqrt(kHuber / chi2);
}

/// What a correction makes of an observation; the same for all poses and points.
struct Corrected {
  Eigen::Vector3d pixel = Eigen::Vector3d::Zero();  // u, v, u_right of the perfect pair, px
  double row = 0;                                   // px
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();  // measured over ideal px of u, v, disparity
};

/// \tparam kRig number of parameters that are free
template <int kRig>
class RigBundle {
 public:
  /// \param free_parameters their numbers
  RigBundle(RigProblem& problem, const std::vector<int>& free_parameters,
            const std::atomic<bool>* stop)
      : p_(problem), parameters_(free_parameters), stop_(stop) {
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
    size_ = 6 * free_ + kRig;
    H_.resize(size_, size_);
    b_.resize(size_);
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
      const Residual r = residual(i, p_.points[k]);
      sum += huber(r.chi2()) + huber(r.row_chi2());
    });
    return 0.5 * sum;
  }

  LevenbergStep step(double damping) {
    if (!solve(damping)) return {LevenbergStep::Outcome::kNone};
    before_ = {p_.T_c_w, p_.points, corrected_, x_, p_.rig};
    move();
    return {LevenbergStep::Outcome::kTaken};
  }

  double cost_of_step() {
    move_points();
    return cost();
  }

  void accept() {}

  void restore() {
    std::swap(p_.T_c_w, before_.T_c_w);
    std::swap(p_.points, before_.points);
    std::swap(corrected_, before_.corrected);
    x_ = before_.x;
    p_.rig = before_.rig;
  }

 private:
  using RigMatrix = Eigen::Matrix<double, kRig, kRig>;
  using RigVector = Eigen::Matrix<double, kRig, 1>;

  /// What a step changes.
  struct State {
    std::vector<Rigid3> T_c_w;
    std::vector<Eigen::Vector3d> points;
    std::vector<Corrected> corrected;
    RigVector x;
    RigCorrection rig;
  };

  [[nodiscard]] Residual residual(std::size_t i, const Eigen::Vector3d& p_w) const {
    const RigProblem::Observation& o = p_.observations[i];
    const Corrected& c = corrected_[i];
    Residual r;
    r.p_c = p_.T_c_w[o.pose] * p_w;
    const double unit = static_cast<double>(o.inv_sigma) * o.inv_sigma;
    r.information.head<2>() << unit, unit * p_.information_v;
    if (!std::isnan(o.measured.u_right)) {
      r.information[2] = unit * p_.information_disparity;
      if (o.row) {
        r.e[3] = c.row;
        r.information[3] = 1 / (kRowSigma * kRowSigma * o.scale * o.scale);
      }
    }
    r.scale = c.scale;
    r.e.head<3>() = r.scale.cwiseProduct(
        reprojection_error(p_.camera, r.p_c, c.pixel.x(), c.pixel.y(), c.pixel.z()));
    return r;
  }

  [[nodiscard]] Corrected correct(const RigProblem::Observation& o) const {
    Corrected c;
    const RigCorrection::Measured& m = o.measured;
    if (std::isnan(m.u_right)) {
      c.pixel.head<2>() = p_.rig.left(m.u, m.v);
    } else {
      const RigCorrection::Ideal ideal = p_.rig.pair(m);
      c.pixel << ideal.u, ideal.v, ideal.u_right;
      c.row = ideal.row;
    }
    const Eigen::Vector2d stretch = p_.rig.stretch(m.u, m.v);
    c.scale << 1 / stretch.x(), 1 / stretch.y(), 1 / (stretch.x() * p_.rig.focal_scale());
    return c;
  }

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
      const Residual r = residual(i, p_.points[k]);
      active_[i] = r.p_c.z() > kMinDepth && r.chi2() < kFarOff ? 1 : 0;
    });
  }

  struct Linear {
    std::int32_t place;                    // of its pose among the unknowns, -1: fixed
    Eigen::Matrix<double, 3, 6> J_pose;    // by the increment of plus_left
    Eigen::Matrix<double, 3, 3> J_point;   // by p_w
    Eigen::Matrix<double, 3, kRig> J_rig;  // by the free parameters
    Eigen::Vector3d e, w;                  // residual and weights
  };

  /// Adds the normal equations of a point, which is eliminated. Products with the parameters are of
  /// sizes for which Eigen would pack matrices: lazyProduct() is faster.
  void eliminate(std::size_t k, double damping) {
    const Eigen::Vector3d& p_w = p_.points[k];
    linear_.clear();
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for_observations(k, [&](std::size_t i) {
      const RigProblem::Observation& o = p_.observations[i];
      const Residual r = residual(i, p_w);
      // Where the point is expected: at the measured place noise would correlate with the slopes.
      RigCorrection::Measured expected = o.measured;
      expected.u += static_cast<float>(r.e[0]);
      expected.v += static_cast<float>(r.e[1]);
      expected.u_right += static_cast<float>(r.e[0] - r.e[2]);
      expected.v_right += static_cast<float>(r.e[1] - r.e[3]);
      const Eigen::Matrix<double, 4, kRig> J = free_columns(p_.rig.jacobian(expected));
      Linear l;
      l.place = place_[o.pose];
      const Eigen::Matrix3d J_c = r.scale.asDiagonal() * reprojection_jacobian(p_.camera, r.p_c);
      l.J_pose << -J_c * hat(r.p_c), J_c;
      l.J_point = J_c * p_.T_c_w[o.pose].R();
      l.J_rig = -(r.scale.asDiagonal() * J.template topRows<3>());
      if (r.information[2] == 0) l.J_rig.row(2).setZero();
      l.e = r.e.head<3>();
      l.w = huber_weight(r.chi2()) * r.information.head<3>();
      V.noalias() += l.J_point.transpose() * l.w.asDiagonal() * l.J_point;
      g.noalias() += l.J_point.transpose() * l.w.cwiseProduct(l.e);
      linear_.push_back(l);
      if (r.information[3] > 0) add_row(J.row(3), r);
    });
    if (linear_.size() < 2) return;
    V.diagonal() += (damping * V.diagonal().array() + kPointDamping).matrix();
    const Eigen::LLT<Eigen::Matrix3d> factor(V);
    const Eigen::Matrix3d L_inverse = factor.matrixL().solve(Eigen::Matrix3d::Identity());
    const Eigen::Vector3d y = L_inverse * g;
    // What is left of every unknown after the point: Z = L^-1 J_point^T W J.
    Z_.resize(linear_.size());
    Eigen::Matrix<double, 3, kRig> Z_rig = Eigen::Matrix<double, 3, kRig>::Zero();
    for (std::size_t a = 0; a < linear_.size(); ++a) {
      const Linear& l = linear_[a];
      const Eigen::Matrix3d half = L_inverse * l.J_point.transpose() * l.w.asDiagonal();
      Z_[a] = half * l.J_pose;
      Z_rig += half.lazyProduct(l.J_rig);
    }
    const auto rig = static_cast<Eigen::Index>(6 * free_);
    for (std::size_t a = 0; a < linear_.size(); ++a) {
      const Linear& l = linear_[a];
      const Eigen::Matrix<double, 3, kRig> weighted = l.w.asDiagonal() * l.J_rig;
      H_.template block<kRig, kRig>(rig, rig).noalias() +=
          l.J_rig.transpose().lazyProduct(weighted);
      b_.template segment<kRig>(rig).noalias() += weighted.transpose() * l.e;
      if (l.place < 0) continue;
      H_.block<6, 6>(l.place, l.place).noalias() +=
          l.J_pose.transpose() * l.w.asDiagonal() * l.J_pose;
      H_.template block<kRig, 6>(rig, l.place) +=
          weighted.transpose().lazyProduct(l.J_pose) - Z_rig.transpose().lazyProduct(Z_[a]);
      b_.segment<6>(l.place).noalias() +=
          l.J_pose.transpose() * l.w.cwiseProduct(l.e) - Z_[a].transpose() * y;
      for (std::size_t c = 0; c < linear_.size(); ++c) {
        const std::int32_t other = linear_[c].place;
        if (other < 0 || other > l.place) continue;
        H_.block<6, 6>(l.place, other).noalias() -= Z_[a].transpose() * Z_[c];
      }
    }
    H_.template block<kRig, kRig>(rig, rig).noalias() -= Z_rig.transpose().lazyProduct(Z_rig);
    b_.template segment<kRig>(rig).noalias() -= Z_rig.transpose() * y;
  }

  void add_row(const Eigen::Matrix<double, 1, kRig>& J, const Residual& r) {
    const double w = huber_weight(r.row_chi2()) * r.information[3];
    const auto rig = static_cast<Eigen::Index>(6 * free_);
    H_.template block<kRig, kRig>(rig, rig).noalias() += w * J.transpose() * J;
    b_.template segment<kRig>(rig) += w * r.e[3] * J.transpose();
  }

  /// The normal equations without the points, lower triangle.
  void linearise(double damping) {
    H_.setZero();
    b_.setZero();
    for (std::size_t k = 0; k < p_.points.size(); ++k) eliminate(k, damping);
    const auto rig = static_cast<Eigen::Index>(6 * free_);
    H_.template block<kRig, kRig>(rig, rig) += prior_information_;
    b_.template segment<kRig>(rig) += prior_information_ * x_;
  }

  /// Solves for a step of all unknowns; false when the equations have no solution.
  bool solve(double damping) {
    linearise(damping);
    H_.diagonal() += damping * H_.diagonal().cwiseMax(Damping::kMinDiagonal);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(H_);
    if (factor.info() != Eigen::Success) return false;
    step_ = factor.solve(-b_);
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
    corrected_.resize(p_.observations.size());
    for (std::size_t i = 0; i < corrected_.size(); ++i) {
      corrected_[i] = correct(p_.observations[i]);
    }
  }

  [[nodiscard]] Eigen::Matrix<double, 4, kRig> free_columns(const RigJacobian& J) const {
    Eigen::Matrix<double, 4, kRig> chosen;
    for (int k = 0; k < kRig; ++k) chosen.col(k) = J.col(parameters_[k]);
    return chosen;
  }

  [[nodiscard]] double point_cost(std::size_t k, const Eigen::Vector3d& p_w) const {
    double sum = 0;
    for_observations(k, [&](std::size_t i) { sum += huber(residual(i, p_w).chi2()); });
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
          const Residual r = residual(i, p_.points[k]);
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
      const Residual r = residual(i, p_.points[k]);
      residuals += r.information[2] > 0 ? 3 : 2;
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
  int size_ = 0;
  RigMatrix prior_information_;
  RigVector x_;                       // free parameters less those of the prior
  std::vector<Corrected> corrected_;  // per observation, by the present correction
  State before_;                      // the step
  std::vector<std::uint8_t> active_;
  std::vector<Linear> linear_;  // of the point worked on
  std::vector<Eigen::Matrix<double, 3, 6>> Z_;
  Eigen::MatrixXd H_;
  Eigen::VectorXd b_, step_;
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
