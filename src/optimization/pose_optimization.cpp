// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_optimization.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "geometry/minimise_pose.h"
#include "geometry/so3.h"
#include "optimization/reprojection_lanes.h"

namespace kys_slam {

void describe(kys::OptionList& list, PoseOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("pose.rounds", o.rounds, {1, 1000});
  list.add("pose.iterations", o.iterations, {0, 1000});
  list.add("pose.chi2_mono", o.chi2_mono, {0.1, 1e6});
  list.add("pose.chi2_stereo", o.chi2_stereo, {0.1, 1e6});
}

/// Four observations side by side.
struct ObservationLanes : MeasuredLanes {
  Lanes x{}, y{}, z{};  // p_w, m
  Lanes share{};        // factor on the information
  Lanes active{};       // share of those that take part in this round, else 0
};

namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kMinObservations = 3;

/// Lower triangle of J^T W J row by row, then J^T W r, then the cost, each per lane.
constexpr int kHessianSize = 21;
struct NormalLanes {
  Lanes hessian[kHessianSize]{};
  Lanes gradient[6]{};
  Lanes cost{};
};

/// Reprojection errors of four observations from the pose [R|t] (row-major 3x4).
KYS_ALWAYS_INLINE void errors_from(const ObservationLanes& o, const CameraNumbers& camera,
                                   const double* T, LaneErrors& e) {
  e.x = T[0] * o.x + T[1] * o.y + T[2] * o.z + T[3];
  e.y = T[4] * o.x + T[5] * o.y + T[6] * o.z + T[7];
  e.z = T[8] * o.x + T[9] * o.y + T[10] * o.z + T[11];
  errors_of(o, camera, e);
}

/// Adds four observations to the sums.
KYS_ALWAYS_INLINE void accumulate(const ObservationLanes& o, const CameraNumbers& camera,
                                  const double* T, bool robust, NormalLanes& sums) {
  LaneErrors e;
  errors_from(o, camera, T, e);
  const Lanes robust_w = huber_weight(o.bound, e.chi2, robust, o.active, sums.cost);
  LaneNormal n;
  normal_of(e, camera, o, robust_w, n);
  LanePoseNormal p;
  pose_normal_of(e, n, p);
  Lanes* h = sums.hessian;
  h[0] += p.h00;
  h[1] += p.h10;
  h[2] += p.h11;
  h[3] += p.h20;
  h[4] += p.h21;
  h[5] += p.h22;
  h[6] += p.b00;
  h[7] += p.b10;
  h[8] += p.b20;
  h[9] += n.a00;
  h[10] += p.b01;
  h[11] += p.b11;
  h[12] += p.b21;
  h[14] += n.a11;  // h[13], A10, stays zero
  h[15] += p.b02;
  h[16] += p.b12;
  h[17] += p.b22;
  h[18] += n.a02;
  h[19] += n.a12;
  h[20] += n.a22;
  sums.gradient[0] += p.g0;
  sums.gradient[1] += p.g1;
  sums.gradient[2] += p.g2;
  sums.gradient[3] += n.g0;
  sums.gradient[4] += n.g1;
  sums.gradient[5] += n.g2;
}

KYS_VECTOR_CLONES void accumulate_all(const ObservationLanes* lanes, int count,
                                      const CameraNumbers& camera, const double* T, bool robust,
                                      NormalLanes& sums) {
  for (int i = 0; i < count; ++i) accumulate(lanes[i], camera, T, robust, sums);
}

/// chi2 over its bound; infinite where there is no error to speak of.
KYS_ALWAYS_INLINE void relative_error(const ObservationLanes& o, const CameraNumbers& camera,
                                      const double* T, double* errors) {
  LaneErrors e;
  errors_from(o, camera, T, e);
  const LaneMask usable = o.bound > 0.0;
  const LaneMask valid = usable & (e.z >= kMinDepth);
  const Lanes infinite = broadcast(std::numeric_limits<double>::infinity());
  const Lanes error = valid ? e.chi2 / (usable ? o.bound : broadcast(1.0)) : infinite;
  for (int lane = 0; lane < kLanes; ++lane) errors[lane] = error[lane];
}

KYS_VECTOR_CLONES void relative_errors(const ObservationLanes* lanes, int count,
                                       const CameraNumbers& camera, const double* T,
                                       double* errors) {
  for (int i = 0; i < count; ++i) relative_error(lanes[i], camera, T, errors + i * kLanes);
}

/// Observations side by side; one that is not finite keeps a bound of zero.
std::vector<ObservationLanes> packed(std::span<const PoseObservation> observations,
                                     const PoseOptions& options) {
  std::vector<ObservationLanes> lanes((observations.size() + kLanes - 1) / kLanes);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const PoseObservation& from = observations[i];
    ObservationLanes& to = lanes[i / kLanes];
    const auto lane = static_cast<int>(i % kLanes);
    if (!is_usable(from.p_w) || !is_usable(from.u, from.v, from.u_right, from.inv_sigma)) continue;
    if (!(from.share >= 0)) continue;
    const bool stereo = !std::isnan(from.u_right);
    to.x[lane] = from.p_w.x();
    to.y[lane] = from.p_w.y();
    to.z[lane] = from.p_w.z();
    to.u[lane] = from.u;
    to.v[lane] = from.v;
    to.u_right[lane] = stereo ? from.u_right : 0;
    to.weight[lane] = static_cast<double>(from.inv_sigma) * from.inv_sigma;
    to.ratio_v[lane] = from.ratio.v;
    to.weight_disparity[lane] = stereo ? to.weight[lane] * from.ratio.disparity : 0;
    to.bound[lane] = stereo ? options.chi2_stereo : options.chi2_mono;
    to.share[lane] = from.share;
  }
  return lanes;
}

/// The observations of one frame and what optimize_pose asks of them.
class PoseProblem {
 public:
  PoseProblem(const StereoCamera& camera, std::span<const PoseObservation> observations,
              const PoseOptions& options)
      : camera_(camera), prior_(options.prior), lanes_(packed(observations, options)) {}

  [[nodiscard]] PoseNormalEquations linearise(const Rigid3& T_c_w, bool robust) const {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_c_w.matrix();
    NormalLanes sums;
    accumulate_all(lanes_.data(), static_cast<int>(lanes_.size()), camera_, T.data(), robust, sums);
    PoseNormalEquations result;
    for (int row = 0, k = 0; row < 6; ++row) {
      for (int col = 0; col <= row; ++col, ++k) {
        result.hessian(row, col) = result.hessian(col, row) = lane_sum(sums.hessian[k]);
      }
      result.gradient[row] = lane_sum(sums.gradient[row]);
    }
    result.cost = lane_sum(sums.cost);
    if (prior_) add_prior(T_c_w, result);
    return result;
  }

  /// Marks outliers at the pose in `outlier`, sets them aside, and returns how many are left;
  /// `changed` tells whether any changed sides.
  int classify(const Rigid3& T_c_w, std::vector<std::uint8_t>& outlier, bool& changed) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_c_w.matrix();
    int inliers = 0;
    changed = false;
    for (std::size_t group = 0; group < lanes_.size(); ++group) {
      ObservationLanes& o = lanes_[group];
      LaneErrors e;
      errors_from(o, camera_, T.data(), e);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::size_t i = group * kLanes + lane;
        if (i >= outlier.size()) break;
        const bool inlier =
            o.bound[lane] > 0 && e.z[lane] >= kMinDepth && e.chi2[lane] <= o.bound[lane];
        changed |= inlier == (outlier[i] != 0);
        outlier[i] = inlier ? 0 : 1;
        o.active[lane] = inlier ? o.share[lane] : 0;
        inliers += inlier ? 1 : 0;
      }
    }
    return inliers;
  }

  /// Observations in front of the camera take part in the first round, however far off they are.
  int activate_in_front(const Rigid3& T_c_w) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_c_w.matrix();
    int active = 0;
    for (ObservationLanes& o : lanes_) {
      LaneErrors e;
      errors_from(o, camera_, T.data(), e);
      for (int lane = 0; lane < kLanes; ++lane) {
        const bool use = o.bound[lane] > 0 && e.z[lane] >= kMinDepth;
        o.active[lane] = use ? o.share[lane] : 0;
        active += use ? 1 : 0;
      }
    }
    return active;
  }

 private:
  /// Error [w; v] of T_c_w = [exp(w), v] T_prior, in the increment of the camera frame: |v| is the
  /// distance of the two camera centres.
  void add_prior(const Rigid3& T_c_w, PoseNormalEquations& sums) const {
    const Rigid3 away = T_c_w * prior_->T_c_w.inverse();
    const Vector6d error = left_increment(away);
    const Vector6d weight = left_information(prior_->sigma_rotation, prior_->sigma_position);
    sums.hessian.diagonal() += weight;
    sums.gradient += weight.cwiseProduct(error);
    sums.cost += 0.5 * weight.dot(error.cwiseAbs2());
  }

  CameraNumbers camera_;
  std::optional<PosePrior> prior_;
  std::vector<ObservationLanes> lanes_;
};

/// From the increment of plus_left() to that of plus(): v_moved = v_plus + hat(t) w.
Matrix6d information_of_plus(const Matrix6d& information, const Eigen::Vector3d& t) {
  Matrix6d change = Matrix6d::Identity();
  change.bottomLeftCorner<3, 3>() = hat(t);
  return change.transpose() * information * change;
}

}  // namespace

PoseErrors::PoseErrors(const StereoCamera& camera, std::span<const PoseObservation> observations,
                       const PoseOptions& options)
    : camera_(camera),
      count_(observations.size()),
      lanes_(std::make_shared<const std::vector<ObservationLanes>>(packed(observations, options))) {
}

void PoseErrors::at(const Rigid3& T_c_w, std::vector<double>& errors) const {
  const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_c_w.matrix();
  errors.resize(lanes_->size() * kLanes);
  relative_errors(lanes_->data(), static_cast<int>(lanes_->size()), CameraNumbers(camera_),
                  T.data(), errors.data());
  errors.resize(count_);
}

PoseResult optimize_pose(const StereoCamera& camera, const Rigid3& T_c_w_initial,
                         std::span<const PoseObservation> observations,
                         const PoseOptions& options) {
  if (!camera.is_valid()) throw std::invalid_argument("optimize_pose: camera is not valid");
  PoseResult result;
  result.T_c_w = T_c_w_initial;
  result.outlier.assign(observations.size(), 1);
  if (!T_c_w_initial.is_finite()) return result;

  PoseProblem problem(camera, observations, options);
  if (problem.activate_in_front(T_c_w_initial) < kMinObservations) return result;

  for (int round = 0; round < options.rounds; ++round) {
    // The kernel holds back gross outliers while they are still being found; the last rounds are
    // plain least squares over what is left.
    const bool robust = round < options.rounds / 2;
    result.T_c_w =
        minimise_pose(result.T_c_w, {.iterations = options.iterations},
                      [&](const Rigid3& T_c_w) { return problem.linearise(T_c_w, robust); });
    bool changed = false;
    result.inliers = problem.classify(result.T_c_w, result.outlier, changed);
    if (result.inliers < kMinObservations) break;
    // Another round over the same observations would start where it ends.
    if (!robust && !changed) break;
  }
  if (result.inliers < kMinObservations) {
    result.T_c_w = T_c_w_initial;
    result.inliers = 0;
    result.outlier.assign(observations.size(), 1);
    return result;
  }
  result.information =
      information_of_plus(problem.linearise(result.T_c_w, false).hessian, result.T_c_w.translation);
  return result;
}

double position_sigma(const PoseResult& pose) {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  // Of the increment v of plus(); the centre moves by v + hat(t) w.
  const Eigen::LDLT<Matrix6d> factor(pose.information);
  if (!(factor.vectorD().minCoeff() > 0)) return kUnknown;
  Eigen::Matrix<double, 6, 3> J = Eigen::Matrix<double, 6, 3>::Zero();
  J.topRows<3>() = hat(pose.T_c_w.translation).transpose();
  J.bottomRows<3>().setIdentity();
  const Eigen::Matrix3d covariance = J.transpose() * factor.solve(J);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance, Eigen::EigenvaluesOnly);
  const double largest = eigen.eigenvalues().maxCoeff();
  return largest > 0 ? std::sqrt(largest) : kUnknown;
}

}  // namespace kys_slam
