#include "optimization/pose_optimization.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "geometry/reprojection.h"
#include "util/lanes.h"

namespace kys_slam {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kMinObservations = 3;
constexpr double kStepTolerance = 1e-9;  // rad and m: far below what a pixel can tell
constexpr double kCostTolerance = 1e-7;  // relative

/// Four observations side by side. Weights are 1/px^2, and zero where there is nothing to weigh:
/// lanes past the end, and the right image of monocular observations.
struct ObservationLanes {
  Lanes x{}, y{}, z{};        // p_w, m
  Lanes u{}, v{}, u_right{};  // px
  Lanes weight{}, weight_disparity{};
  Lanes bound{};   // chi2 that separates outliers, and the square of Huber's delta
  Lanes share{};   // factor on the information
  Lanes active{};  // share of those that take part in this round, else 0
};

/// The increment here is that of the camera frame, p_c -> exp(w) p_c + v, whose Jacobian is the
/// sparsest. Lower triangle of J^T W J row by row, then J^T W r, then the cost, each per lane.
constexpr int kHessianSize = 21;
struct NormalLanes {
  Lanes hessian[kHessianSize]{};
  Lanes gradient[6]{};
  Lanes cost{};
};

struct NormalEquations {
  Matrix6d hessian;
  Vector6d gradient;
  double cost = 0;
};

struct CameraNumbers {
  double fx, fy, cx, cy, bf;
};

/// Reprojection errors of four observations from the pose [R|t] (row-major 3x4).
struct LaneErrors {
  Lanes x, y, z, inverse, derivative, du, dv, dd, chi2;
};

KYS_ALWAYS_INLINE LaneErrors errors_of(const ObservationLanes& o, const CameraNumbers& camera,
                                       const double* T) {
  LaneErrors e;
  e.x = T[0] * o.x + T[1] * o.y + T[2] * o.z + T[3];
  e.y = T[4] * o.x + T[5] * o.y + T[6] * o.z + T[7];
  e.z = T[8] * o.x + T[9] * o.y + T[10] * o.z + T[11];
  // The same continuation below kMinDepth as InverseDepth.
  constexpr double kTop = 1.0 / kMinDepth;
  const LaneMask far = e.z >= kMinDepth;
  const Lanes reciprocal = 1.0 / (far ? e.z : broadcast(1.0));
  e.inverse = far ? reciprocal : 2.0 * kTop - e.z * (kTop * kTop);
  e.derivative = far ? -reciprocal * reciprocal : broadcast(-kTop * kTop);
  const Lanes u = camera.fx * e.x * e.inverse + camera.cx;
  e.du = u - o.u;
  e.dv = camera.fy * e.y * e.inverse + camera.cy - o.v;
  e.dd = camera.bf * e.inverse - (o.u - o.u_right);
  e.chi2 = o.weight * (e.du * e.du + e.dv * e.dv) + o.weight_disparity * e.dd * e.dd;
  return e;
}

/// Huber's weight of each observation and its share of the cost (1/2 rho), both zero if inactive.
KYS_ALWAYS_INLINE Lanes robust_weight(const ObservationLanes& o, const Lanes& chi2, bool robust,
                                      Lanes& cost) {
  const LaneMask beyond = chi2 > o.bound;
  if (!robust || !any(beyond)) {
    cost += 0.5 * o.active * chi2;
    return o.active;
  }
  const Lanes root = sqrt_lanes(beyond ? chi2 * o.bound : broadcast(1.0));
  cost += 0.5 * o.active * (beyond ? 2.0 * root - o.bound : chi2);
  return o.active * (beyond ? o.bound / root : broadcast(1.0));
}

/// Adds four observations to the sums.
KYS_ALWAYS_INLINE void accumulate(const ObservationLanes& o, const CameraNumbers& camera,
                                  const double* T, bool robust, NormalLanes& sums) {
  const LaneErrors e = errors_of(o, camera, T);
  const Lanes robust_w = robust_weight(o, e.chi2, robust, sums.cost);
  const Lanes w = robust_w * o.weight;
  const Lanes w_disparity = robust_w * o.weight_disparity;

  // d(u,v,disparity)/dp_c = [a 0 b; 0 c d; 0 0 f]
  const Lanes a = camera.fx * e.inverse;
  const Lanes b = camera.fx * e.x * e.derivative;
  const Lanes c = camera.fy * e.inverse;
  const Lanes d = camera.fy * e.y * e.derivative;
  const Lanes f = camera.bf * e.derivative;
  // A = J^T W J over p_c (a 3x3 block with A01 = 0 but for mixed terms), g = J^T W r.
  const Lanes wa = w * a;
  const Lanes a00 = wa * a;
  const Lanes a02 = wa * b;
  const Lanes a11 = w * c * c;
  const Lanes a12 = w * c * d;
  const Lanes a22 = w * (b * b + d * d) + w_disparity * f * f;
  const Lanes g0 = wa * e.du;
  const Lanes g1 = w * c * e.dv;
  const Lanes g2 = w * (b * e.du + d * e.dv) + w_disparity * f * e.dd;

  // dp_c/d[w v] = [-hat(p) I]; B = hat(p) A (rotation rows, translation columns).
  const Lanes b00 = e.y * a02;
  const Lanes b01 = e.y * a12 - e.z * a11;
  const Lanes b02 = e.y * a22 - e.z * a12;
  const Lanes b10 = e.z * a00 - e.x * a02;
  const Lanes b11 = -e.x * a12;
  const Lanes b12 = e.z * a02 - e.x * a22;
  const Lanes b20 = -e.y * a00;
  const Lanes b21 = e.x * a11;
  const Lanes b22 = e.x * a12 - e.y * a02;
  // hat(p) A hat(p)^T, lower triangle: row i of B times hat(p)^T.
  Lanes* h = sums.hessian;
  h[0] += b02 * e.y - b01 * e.z;
  h[1] += b12 * e.y - b11 * e.z;
  h[2] += b10 * e.z - b12 * e.x;
  h[3] += b22 * e.y - b21 * e.z;
  h[4] += b20 * e.z - b22 * e.x;
  h[5] += b21 * e.x - b20 * e.y;
  h[6] += b00;
  h[7] += b10;
  h[8] += b20;
  h[9] += a00;
  h[10] += b01;
  h[11] += b11;
  h[12] += b21;
  h[14] += a11;  // h[13], A10, stays zero
  h[15] += b02;
  h[16] += b12;
  h[17] += b22;
  h[18] += a02;
  h[19] += a12;
  h[20] += a22;
  sums.gradient[0] += e.y * g2 - e.z * g1;
  sums.gradient[1] += e.z * g0 - e.x * g2;
  sums.gradient[2] += e.x * g1 - e.y * g0;
  sums.gradient[3] += g0;
  sums.gradient[4] += g1;
  sums.gradient[5] += g2;
}

KYS_VECTOR_CLONES void accumulate_all(const ObservationLanes* lanes, int count,
                                      const CameraNumbers& camera, const double* T, bool robust,
                                      NormalLanes& sums) {
  for (int i = 0; i < count; ++i) accumulate(lanes[i], camera, T, robust, sums);
}

/// The observations of one frame and what optimize_pose asks of them.
class PoseProblem {
 public:
  PoseProblem(const StereoCamera& camera, std::span<const PoseObservation> observations,
              const PoseOptions& options)
      : camera_{camera.fx, camera.fy, camera.cx, camera.cy, camera.bf()},
        observations_(observations),
        prior_(options.prior),
        lanes_((observations.size() + kLanes - 1) / kLanes) {
    for (std::size_t i = 0; i < observations.size(); ++i) pack(i, options);
  }

  [[nodiscard]] NormalEquations linearise(const Rigid3& T_c_w, bool robust) const {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T = T_c_w.matrix();
    NormalLanes sums;
    accumulate_all(lanes_.data(), static_cast<int>(lanes_.size()), camera_, T.data(), robust, sums);
    NormalEquations result;
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
      const LaneErrors e = errors_of(o, camera_, T.data());
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
      const LaneErrors e = errors_of(o, camera_, T.data());
      for (int lane = 0; lane < kLanes; ++lane) {
        const bool use = o.bound[lane] > 0 && e.z[lane] >= kMinDepth;
        o.active[lane] = use ? o.share[lane] : 0;
        active += use ? 1 : 0;
      }
    }
    return active;
  }

 private:
  /// Writes observation `i` to its lane; one that is not finite keeps a bound of zero.
  void pack(std::size_t i, const PoseOptions& options) {
    const PoseObservation& from = observations_[i];
    ObservationLanes& to = lanes_[i / kLanes];
    const auto lane = static_cast<int>(i % kLanes);
    if (!is_usable(from.p_w) || !is_usable(from.u, from.v, from.u_right, from.inv_sigma)) return;
    if (!(from.share >= 0)) return;
    const bool stereo = !std::isnan(from.u_right);
    to.x[lane] = from.p_w.x();
    to.y[lane] = from.p_w.y();
    to.z[lane] = from.p_w.z();
    to.u[lane] = from.u;
    to.v[lane] = from.v;
    to.u_right[lane] = stereo ? from.u_right : 0;
    to.weight[lane] = static_cast<double>(from.inv_sigma) * from.inv_sigma;
    to.weight_disparity[lane] = stereo ? to.weight[lane] : 0;
    to.bound[lane] = stereo ? options.chi2_stereo : options.chi2_mono;
    to.share[lane] = from.share;
  }

  /// Error [w; v] of T_c_w = [exp(w), v] T_prior, in the increment of the camera frame: |v| is the
  /// distance of the two camera centres.
  void add_prior(const Rigid3& T_c_w, NormalEquations& sums) const {
    const Rigid3 away = T_c_w * prior_->T_c_w.inverse();
    Vector6d error;
    error << so3_log(away.rotation), away.translation;
    Vector6d weight;
    weight.head<3>().setConstant(1 / (prior_->sigma_rotation * prior_->sigma_rotation));
    weight.tail<3>().setConstant(1 / (prior_->sigma_position * prior_->sigma_position));
    sums.hessian.diagonal() += weight;
    sums.gradient += weight.cwiseProduct(error);
    sums.cost += 0.5 * weight.dot(error.cwiseAbs2());
  }

  CameraNumbers camera_;
  std::span<const PoseObservation> observations_;
  std::optional<PosePrior> prior_;
  std::vector<ObservationLanes> lanes_;
};

/// The pose moved in the camera frame: p_c -> exp(w) p_c + v.
Rigid3 moved(const Rigid3& T_c_w, const Vector6d& delta) {
  const Eigen::Quaterniond turn = so3_exp(delta.head<3>());
  return {turn * T_c_w.rotation, turn * T_c_w.translation + delta.tail<3>()};
}

/// Levenberg-Marquardt from `T_c_w`, at most `iterations` linearisations. Returns the best pose.
Rigid3 minimise(const PoseProblem& problem, Rigid3 T_c_w, bool robust, int iterations) {
  NormalEquations best = problem.linearise(T_c_w, robust);
  double damping = 1e-6;
  for (int i = 0; i < iterations; ++i) {
    Matrix6d damped = best.hessian;
    damped.diagonal() += damping * best.hessian.diagonal() + Vector6d::Constant(1e-12);
    const Eigen::LDLT<Matrix6d> factor(damped);
    const Vector6d step = factor.solve(-best.gradient);
    if (!step.allFinite()) break;
    const Rigid3 candidate = moved(T_c_w, step);
    const NormalEquations next = problem.linearise(candidate, robust);
    if (next.cost <= best.cost) {
      const double decrease = best.cost - next.cost;
      const bool converged =
          step.lpNorm<Eigen::Infinity>() < kStepTolerance || decrease <= kCostTolerance * best.cost;
      T_c_w = candidate;
      best = next;
      damping = std::max(damping * 0.1, 1e-9);
      if (converged) break;
    } else {
      if (step.lpNorm<Eigen::Infinity>() < kStepTolerance) break;
      damping *= 100;
    }
  }
  return T_c_w;
}

/// From the increment of moved() to that of plus(): v_moved = v_plus + hat(t) w.
Matrix6d information_of_plus(const Matrix6d& information, const Eigen::Vector3d& t) {
  Matrix6d change = Matrix6d::Identity();
  change.bottomLeftCorner<3, 3>() = hat(t);
  return change.transpose() * information * change;
}

}  // namespace

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
    result.T_c_w = minimise(problem, result.T_c_w, robust, options.iterations);
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
