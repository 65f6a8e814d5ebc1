// SPDX-License-Identifier: BSD-3-Clause
#include "motion/instance_motion.h"

#include <kys/portable_math.h>
#include <kys_slam/error.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "geometry/reprojection.h"
#include "map/frame_features.h"
#include "motion/match_lanes.h"

namespace kys_slam {

void describe(kys::OptionList& list, InstanceMotionOptions& o) {
  list.add("motion.pixel_sigma", o.pixel_sigma, {0.001, 100}, "px",
           "standard deviation of a keypoint at octave 0, for tests of instances");
  list.add("motion.disparity_sigma", o.disparity_sigma, {0.001, 100}, "px",
           "the same of its disparity");
  list.add("motion.max_chi2", o.max_chi2, {0.1, 1e6}, "", "limit of the chi-square of a match");
  list.add("motion.min_matches", o.min_matches, {3, 60000}, "",
           "matches below which an instance is not tested");
  list.add("motion.iterations", o.iterations, {1, 1000}, "", "iterations of a fit");
}

namespace {

constexpr double kMinDisparity = 1;        // px, below this depth means nothing
constexpr double kTurnTolerance = 1e-5;    // rad: far below what the matches can tell
constexpr double kShiftTolerance = 1e-4;   // m
constexpr double kRough = 10;              // times these: where the last steps start from
constexpr double kObservedRotation = 0.5;  // of the range: the matches have halved what was unknown

/// A match as the fits need it: where a still point would be now, and its error there.
struct Point {
  Eigen::Vector3d q;         // m, T_now_before x_before
  Eigen::Vector3d observed;  // u, v, disparity now, px
  Eigen::Matrix3d sigma_q;   // of q, m^2
  Eigen::Vector3d sigma_z;   // variances of `observed`, px^2
};

double disparity(const StereoPixel& p) {
  return static_cast<double>(p.u) - p.u_right;
}

bool is_stereo(const StereoPixel& p) {
  return is_usable(p.u, p.v, p.u_right, p.inv_sigma) && disparity(p) >= kMinDisparity;
}

/// Variances of (u, v, disparity): those of octave 0 at the keypoint's scale, smaller where the
/// keypoint is aligned.
Eigen::Vector3d variances(const StereoPixel& p, const InstanceMotionOptions& options) {
  const double scale = 1.0 / (static_cast<double>(p.inv_sigma) * kPixelSigma);
  const double pixel = kys::portable::power(options.pixel_sigma * scale, 2);
  return {pixel, pixel, kys::portable::power(options.disparity_sigma * scale, 2)};
}

Point prepare(const StereoCamera& camera, const InstanceMatch& match, const Rigid3& T_now_before,
              const InstanceMotionOptions& options) {
  const double d = disparity(match.before);
  const double z = camera.bf() / d;
  const Eigen::Vector3d p = camera.back_project(match.before.u, match.before.v, z);
  Eigen::Matrix3d J;  // of p by (u, v, disparity)
  J << z / camera.fx, 0, -p.x() / d, 0, z / camera.fy, -p.y() / d, 0, 0, -z / d;
  const Eigen::Matrix3d RJ = T_now_before.R() * J;
  Point point;
  point.q = T_now_before * p;
  point.observed = {match.now.u, match.now.v, disparity(match.now)};
  point.sigma_q = RJ * variances(match.before, options).asDiagonal() * RJ.transpose();
  point.sigma_z = variances(match.now, options);
  return point;
}

Eigen::Vector3d back_project(const StereoCamera& camera, const Eigen::Vector3d& uvd) {
  return camera.back_project(uvd.x(), uvd.y(), camera.bf() / uvd.z());
}

/// Sums over the points at one motion: curvature A and gradient b of half the chi-squares that are
/// not cut off, the cut-off cost, how many are not.
struct Sums {
  Matrix6d A;
  Vector6d b;
  double cost = 0;
  int inliers = 0;
  Eigen::Vector3d q;  // of those that are not cut off, summed
};

KYS_VECTOR_CLONES void weigh_all(MatchLanes* lanes, std::size_t count, const MotionLanes& motion,
                                 const CameraNumbers& camera) {
  for (std::size_t k = 0; k < count; ++k) weigh(lanes[k], motion, camera);
}

KYS_VECTOR_CLONES void add_all(const MatchLanes* lanes, std::size_t count,
                               const MotionLanes& motion, const CameraNumbers& camera,
                               double max_chi2, bool soft, MatchSums& sums) {
  for (std::size_t k = 0; k < count; ++k) {
    add(lanes[k], motion, camera, max_chi2, soft, sums);
  }
}

std::vector<MatchLanes> in_lanes(std::span<const Point> points) {
  std::vector<MatchLanes> lanes((points.size() + kLanes - 1) / kLanes);
  for (std::size_t i = 0; i < kLanes * lanes.size(); ++i) {
    MatchLanes& to = lanes[i / kLanes];
    const std::size_t l = i % kLanes;
    const Point& from = points[std::min(i, points.size() - 1)];
    to.active[l] = i < points.size() ? 1 : 0;
    to.qx[l] = from.q.x();
    to.qy[l] = from.q.y();
    to.qz[l] = from.q.z();
    to.u[l] = from.observed.x();
    to.v[l] = from.observed.y();
    to.disparity[l] = from.observed.z();
    for (int row = 0, k = 0; row < 3; ++row) {
      for (int column = row; column < 3; ++column) {
        to.sigma_q[k++][l] = from.sigma_q(row, column);
      }
    }
    to.sigma_u[l] = from.sigma_z.x();
    to.sigma_v[l] = from.sigma_z.y();
    to.sigma_d[l] = from.sigma_z.z();
  }
  return lanes;
}

/// The points of one instance under rigid motions about a centre.
class Fit {
 public:
  Fit(const StereoCamera& camera, std::span<const Point> points, const Eigen::Vector3d& centre,
      const InstanceMotionOptions& options)
      : camera_(camera), lanes_(in_lanes(points)), centre_(centre), options_(options) {}

  /// Motion of largest posterior, its prior being N(0, P): soft weights first, then the cut. From a
  /// start that is far off a sharp cut would drop the right matches and keep the wrong ones.
  [[nodiscard]] Vector6d minimise(Vector6d xi, const Matrix6d& information) {
    weigh(xi);
    for (int i = 0; i < options_.iterations; ++i) {
      if (!advance(xi, information, true)) break;
    }
    weigh(xi);
    for (int i = 0; i < options_.iterations; ++i) {
      if (!advance(xi, information, false)) break;
    }
    return xi;
  }

  /// \param soft Cauchy weights instead of a sharp cut, for the way to the minimum
  [[nodiscard]] Sums sum(const Vector6d& xi, bool soft) const {
    MatchSums lanes;
    add_all(lanes_.data(), lanes_.size(), motion(xi), camera_, options_.max_chi2, soft, lanes);
    Sums sums;
    const auto symmetric = [](const LaneList<6>& from, auto&& to) {
      for (int row = 0, k = 0; row < 3; ++row) {
        for (int column = row; column < 3; ++column) {
          const double total = lane_sum(from[k++]);
          to(row, column) = total;
          to(column, row) = total;
        }
      }
    };
    symmetric(lanes.ww, sums.A.topLeftCorner<3, 3>());
    symmetric(lanes.vv, sums.A.bottomRightCorner<3, 3>());
    for (int k = 0; k < 9; ++k) {
      sums.A(k / 3, 3 + k % 3) = lane_sum(lanes.wv[k]);
    }
    sums.A.bottomLeftCorner<3, 3>() = sums.A.topRightCorner<3, 3>().transpose();
    for (int k = 0; k < 3; ++k) {
      sums.b[k] = lane_sum(lanes.gw[k]);
      sums.b[3 + k] = lane_sum(lanes.gv[k]);
      sums.q[k] = lane_sum(lanes.q[k]);
    }
    sums.cost = lane_sum(lanes.cost);
    sums.inliers = static_cast<int>(std::lround(lane_sum(lanes.inliers)));
    return sums;
  }

 private:
  [[nodiscard]] MotionLanes motion(const Vector6d& xi) const {
    MotionLanes m;
    const Eigen::Matrix3d R = so3_exp(xi.head<3>()).toRotationMatrix();
    for (int k = 0; k < 9; ++k) m.R[static_cast<std::size_t>(k)] = R(k / 3, k % 3);
    for (int k = 0; k < 3; ++k) {
      m.centre[static_cast<std::size_t>(k)] = centre_[k];
      m.shift[static_cast<std::size_t>(k)] = xi[3 + k];
    }
    return m;
  }

  /// Inverse covariances of the errors, linearised at `xi`.
  void weigh(const Vector6d& xi) { weigh_all(lanes_.data(), lanes_.size(), motion(xi), camera_); }

  /// One step; false at the minimum.
  [[nodiscard]] bool advance(Vector6d& xi, const Matrix6d& information, bool soft) const {
    const Sums sums = sum(xi, soft);
    const Vector6d step = (sums.A + information).ldlt().solve(-(sums.b + information * xi));
    if (!step.allFinite()) return false;
    // The rotation moves on the left; the prior is flat enough for the difference.
    xi << so3_log(so3_exp(step.head<3>()) * so3_exp(xi.head<3>())), xi.tail<3>() + step.tail<3>();
    const double size =
        std::max(step.head<3>().norm() / kTurnTolerance, step.tail<3>().norm() / kShiftTolerance);
    return size > (soft ? kRough : 1.0);
  }

  CameraNumbers camera_;
  std::vector<MatchLanes> lanes_;
  Eigen::Vector3d centre_;
  const InstanceMotionOptions& options_;
};

/// A hypothesis fitted to the points: -2 ln of its marginal likelihood by Laplace's method, but for
/// what all hypotheses share. In the linear case with nothing cut off it is exact: the matrix
/// inversion lemma turns the stacked Gaussian N(0, S + J P J^T) into these terms.
struct Fitted {
  Vector6d xi;
  Sums sums;
  double deviance = 0;
};

Fitted fitted(Fit& fit, const Vector6d& start, const Matrix6d& P, const Matrix6d& information) {
  Fitted result;
  result.xi = fit.minimise(start, information);
  result.sums = fit.sum(result.xi, false);
  const double occam =
      kys::portable::log(std::abs((Matrix6d::Identity() + P * result.sums.A).determinant()));
  result.deviance = result.sums.cost + result.xi.dot(information * result.xi) + occam;
  return result;
}

/// Median of each coordinate of where the points are less where they would be standing still.
Eigen::Vector3d median_shift(const StereoCamera& camera, std::span<const Point> points) {
  Eigen::Vector3d shift;
  std::vector<double> values(points.size());
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      values[i] = (back_project(camera, points[i].observed) - points[i].q)[axis];
    }
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    shift[axis] = *middle;
  }
  return shift;
}

Eigen::Vector3d median_place(std::span<const Point> points) {
  Eigen::Vector3d place;
  std::vector<double> values(points.size());
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = points[i].q[axis];
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    place[axis] = *middle;
  }
  return place;
}

/// Covariance of increments p -> exp(w) p + v, expressed about `centre` instead of the origin: the
/// motion of the centre is v + w x c.
Matrix6d about(const Matrix6d& covariance, const Eigen::Vector3d& centre) {
  Matrix6d change = Matrix6d::Identity();
  change.bottomLeftCorner<3, 3>() = -hat(centre);
  return change * covariance * change.transpose();
}

Matrix6d inverse(const Matrix6d& covariance) {
  return covariance.ldlt().solve(Matrix6d::Identity());
}

}  // namespace

/// Two hypotheses are compared by their marginal likelihoods, not by a threshold on a residual as
/// in Eqs. 7 and 8 of the paper: a far object with a few noisy keypoints fits both, and the ratio
/// then is near 1, so that nothing is claimed; a threshold would call it static or moving by its
/// noise. The camera's own uncertainty is common to all points, and is part of the prior of the
/// motion (README, one instance).
InstanceMotion estimate_instance_motion(const StereoCamera& camera,
                                        std::span<const InstanceMatch> matches,
                                        const CameraMotion& ego, const MotionRange& range,
                                        const InstanceMotionOptions& options) {
  InstanceMotion result;
  std::vector<Point> points;
  points.reserve(matches.size());
  for (const InstanceMatch& match : matches) {
    if (!is_stereo(match.before) || !is_stereo(match.now)) continue;
    points.push_back(prepare(camera, match, ego.T_now_before, options));
  }
  result.matches = static_cast<int>(points.size());
  if (result.matches < options.min_matches) return result;

  const Eigen::Vector3d centre = median_place(points);
  // A camera that is known exactly would leave no matrix to invert.
  Matrix6d P_still = about(ego.covariance, centre);
  P_still.diagonal().array() += 1e-10;
  Matrix6d P_moves = P_still;
  P_moves.diagonal().head<3>().array() += range.rotation * range.rotation;
  P_moves.diagonal().tail<3>().array() += range.translation * range.translation;

  // Two starts of the moving hypothesis. Where half of the matches are on what hides the object,
  // the median shift is that of neither; the fit of the static hypothesis then is the better start.
  Fit fit(camera, points, centre, options);
  const Fitted still = fitted(fit, Vector6d::Zero(), P_still, inverse(P_still));
  Vector6d shifted = Vector6d::Zero();
  shifted.tail<3>() = median_shift(camera, points);
  const Matrix6d information = inverse(P_moves);
  Fitted moves = fitted(fit, shifted, P_moves, information);
  if (moves.sums.inliers < result.matches) {
    const Fitted other = fitted(fit, still.xi, P_moves, information);
    if (other.deviance < moves.deviance) moves = other;
  }

  result.log_ratio = 0.5 * (moves.deviance - still.deviance);
  result.inliers = moves.sums.inliers;
  // Expressed about the middle of those that fit: others may be on what stands before the instance.
  const Eigen::Matrix3d R = so3_exp(moves.xi.head<3>()).toRotationMatrix();
  Eigen::Vector3d arm = Eigen::Vector3d::Zero();
  if (moves.sums.inliers > 0) arm = moves.sums.q / moves.sums.inliers - centre;
  result.motion = moves.xi;
  result.motion.tail<3>() += R * arm - arm;
  const Matrix6d posterior = inverse(moves.sums.A + information);
  result.covariance = about(posterior + P_still, arm);
  result.rotation_observed = posterior.diagonal().head<3>().maxCoeff() <
                             kys::portable::power(kObservedRotation * range.rotation, 2);
  result.centre = centre + arm + result.motion.tail<3>();
  result.centre_covariance = about(posterior, arm).bottomRightCorner<3, 3>();
  return result;
}

}  // namespace kys_slam
