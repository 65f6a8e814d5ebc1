// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "geometry/chi_square.h"

namespace kys_slam {

namespace {

using Matrix6d = PoseCovarianceProblem::Matrix6d;
using Eigen::Matrix3d;
using Landmark = PoseCovarianceProblem::Landmark;
using View = PoseCovarianceProblem::View;

// Without enough landmarks a pose is known to 100 m and 1 rad: every inverse exists.
constexpr double kWidest = 100;    // m
constexpr double kWidestTurn = 1;  // rad

// A keyframe is known by other landmarks at least as well as the frame by this share of its own.
constexpr double kOtherLandmarks = 0.05;

// The test for outliers bounds the error of a landmark: where the keyframes say little of it (views
// that do not measure depth), it is known by this share of the information that it gives.
constexpr double kAccepted = 1 / kChi2Stereo95;

// m; a landmark's distance along the ray of views that do not measure depth.
constexpr double kFarthest = 1e4;

/// sum += L^T A L with dp/d[w; v] = L = [-hat(p), I].
void add_sandwich(const Eigen::Vector3d& p, const Matrix3d& A, Matrix6d& sum) {
  const Matrix3d P = hat(p);
  const Matrix3d PA = P * A;
  sum.topLeftCorner<3, 3>().noalias() -= PA * P;
  sum.topRightCorner<3, 3>() += PA;
  sum.bottomLeftCorner<3, 3>().noalias() -= A * P;
  sum.bottomRightCorner<3, 3>() += A;
}

Matrix6d symmetric(const Matrix6d& M) {
  return 0.5 * (M + M.transpose());
}

Matrix6d inverse_of(Matrix6d information) {
  information.diagonal().head<3>().array() += 1 / (kWidestTurn * kWidestTurn);
  information.diagonal().tail<3>().array() += 1 / (kWidest * kWidest);
  return information.llt().solve(Matrix6d::Identity());
}

/// Sums over the landmarks. Those with two poses in their names are sums of products.
struct Sums {
  Matrix6d hessian = Matrix6d::Zero(), hessian_before = Matrix6d::Zero();
  Matrix6d noise = Matrix6d::Zero();  // of the frame
  // Covariance of both gradients by errors of the landmarks.
  Matrix6d here = Matrix6d::Zero(), both = Matrix6d::Zero(), before = Matrix6d::Zero();
  // Derivatives of the gradients by the errors of keyframes, and information about these.
  Eigen::Matrix<double, 6, Eigen::Dynamic> by_keyframe, before_by_keyframe;
  Eigen::MatrixXd keyframes;
};

class Summation {
 public:
  explicit Summation(const PoseCovarianceProblem& problem) : problem_(problem) {
    const Eigen::Index size = 6 * problem.keyframes;
    sums_.by_keyframe.setZero(6, size);
    sums_.before_by_keyframe.setZero(6, size);
    sums_.keyframes.setZero(size, size);
  }

  Sums take() {
    for (const Landmark& landmark : problem_.landmarks) add(landmark);
    return std::move(sums_);
  }

 private:
  void add(const Landmark& l) {
    add_sandwich(l.p, l.weight, sums_.hessian);
    add_sandwich(l.p, l.weight_before, sums_.hessian_before);
    add_sandwich(l.p, l.noise, sums_.noise);
    const std::span<const View> views(problem_.views.data() + l.first_view, l.views);
    Matrix3d information = kAccepted * (l.weight + l.weight_before);
    information.diagonal().array() += 1 / (kFarthest * kFarthest);
    for (const View& view : views) information += view.information;
    const Matrix3d from_views = information.inverse();
    const Matrix3d weighted = l.weight * from_views;
    add_sandwich(l.p, weighted * l.weight, sums_.here);
    add_sandwich(l.p, weighted * l.weight_before, sums_.both);
    add_sandwich(l.p, l.weight_before * from_views * l.weight_before, sums_.before);
    const Matrix3d gain_before = l.weight_before * from_views;
    for (const View& view : views) {
      add_block(l, weighted * view.information, view.keyframe, sums_.by_keyframe);
      add_block(l, gain_before * view.information, view.keyframe, sums_.before_by_keyframe);
      add_pairs(l, view, views, from_views);
    }
  }

  template <typename Row>
  static void add_block(const Landmark& l, const Matrix3d& A, int keyframe, Row& row) {
    Matrix6d block = row.template middleCols<6>(6 * keyframe);
    add_sandwich(l.p, A, block);
    row.template middleCols<6>(6 * keyframe) = block;
  }

  /// Lower blocks of the Schur complement of the landmark, of one view with those before it.
  void add_pairs(const Landmark& l, const View& view, std::span<const View> views,
                 const Matrix3d& from_views) {
    const Matrix3d gain = view.information * from_views;
    for (const View& other : views) {
      if (other.keyframe > view.keyframe) continue;
      Matrix3d A = -gain * other.information;
      if (other.keyframe == view.keyframe) A += view.information;
      Matrix6d block = sums_.keyframes.block<6, 6>(6 * view.keyframe, 6 * other.keyframe);
      add_sandwich(l.p, A, block);
      sums_.keyframes.block<6, 6>(6 * view.keyframe, 6 * other.keyframe) = block;
    }
  }

  const PoseCovarianceProblem& problem_;
  Sums sums_;
};

/// Errors of keyframes relative to the reference, as a factor F with covariance F^T F.
class KeyframeErrors {
 public:
  KeyframeErrors(const Sums& sums, int reference) : reference_(reference) {
    const Eigen::Index size = sums.keyframes.rows();
    Eigen::MatrixXd information = sums.keyframes.selfadjointView<Eigen::Lower>();
    // Every keyframe sees other landmarks too.
    for (Eigen::Index k = 0; k < size; k += 6) {
      information.block<6, 6>(k, k) += kOtherLandmarks * sums.hessian;
    }
    information.diagonal().array() += 1 / (kWidest * kWidest);
    information.middleRows<6>(6 * reference).setZero();
    information.middleCols<6>(6 * reference).setZero();
    information.block<6, 6>(6 * reference, 6 * reference).setIdentity();
    factor_.compute(information);
  }

  /// C P C^T of a linear function C of the errors.
  Matrix6d covariance_of(Eigen::Matrix<double, 6, Eigen::Dynamic> C) const {
    C.middleCols<6>(6 * reference_).setZero();
    const Eigen::MatrixXd root = factor_.matrixL().solve(C.transpose());
    return root.transpose() * root;
  }

 private:
  int reference_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace

PoseCovarianceResult pose_covariance(const PoseCovarianceProblem& problem) {
  const Sums sums = Summation(problem).take();
  const Matrix6d A = inverse_of(sums.hessian + problem.prior);
  const Matrix6d by_prior = A * problem.prior;  // of the error of the pose before
  const bool has_before = problem.before.has_value();
  const bool is_keyframe = has_before && problem.before->keyframe >= 0;
  const Matrix6d A_before = has_before && !is_keyframe
                                ? inverse_of(sums.hessian_before + problem.before->prior)
                                : Matrix6d::Zero();
  const std::optional<KeyframeErrors> keyframes =
      problem.keyframes > 0 ? std::optional<KeyframeErrors>(std::in_place, sums, problem.reference)
                            : std::nullopt;

  // Of X times the frame's error by landmarks, own noise and own prior, plus Y times the error of
  // the frame before.
  const auto covariance_of = [&](const Matrix6d& X, const Matrix6d& Y) {
    const Matrix6d XA = X * A;
    Matrix6d sum = XA * (sums.noise + sums.here) * XA.transpose();
    Eigen::Matrix<double, 6, Eigen::Dynamic> by_keyframe = XA * sums.by_keyframe;
    if (is_keyframe) {
      by_keyframe.middleCols<6>(6 * problem.before->keyframe) += Y;
    } else if (has_before) {
      const Matrix6d YA = Y * A_before;
      const Matrix6d both = XA * sums.both * YA.transpose();
      sum += both + both.transpose() + YA * (problem.before->noise + sums.before) * YA.transpose();
      by_keyframe += YA * sums.before_by_keyframe;
    }
    if (keyframes) sum += keyframes->covariance_of(std::move(by_keyframe));
    sum += X * by_prior * problem.prior_error * by_prior.transpose() * X.transpose();
    return symmetric(sum);
  };

  PoseCovarianceResult result;
  const Matrix6d identity = Matrix6d::Identity();
  result.pose = covariance_of(identity, by_prior);
  if (has_before) result.motion = covariance_of(identity, by_prior - identity);
  result.gradient = symmetric(sums.noise + sums.here);
  result.inverse = A;
  const Matrix6d of_prior = problem.prior_error + covariance_of(Matrix6d::Zero(), identity);
  result.noise = symmetric(sums.noise + problem.prior * of_prior * problem.prior);
  return result;
}

}  // namespace kys_slam
