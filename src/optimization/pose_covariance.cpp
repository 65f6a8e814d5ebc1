// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "geometry/so3.h"

namespace kys_slam {

namespace {

using Matrix6d = PoseCovarianceProblem::Matrix6d;
using Eigen::Matrix3d;
using Landmark = PoseCovarianceProblem::Landmark;
using View = PoseCovarianceProblem::View;

// Without enough landmarks a pose is known to this: covariances are positive definite.
constexpr double kWidest = 100;    // m
constexpr double kWidestTurn = 1;  // rad

// A keyframe is known by other landmarks at least as well as the frame by this share of its own.
constexpr double kOtherLandmarks = 0.05;

// m; a landmark's distance along the ray of views that do not measure depth.
constexpr double kFarthest = 1e4;

/// hat(p) A.
Matrix3d cross(const Eigen::Vector3d& p, const Matrix3d& A) {
  Matrix3d PA;
  PA.row(0) = p.y() * A.row(2) - p.z() * A.row(1);
  PA.row(1) = p.z() * A.row(0) - p.x() * A.row(2);
  PA.row(2) = p.x() * A.row(1) - p.y() * A.row(0);
  return PA;
}

/// sum += L^T A L with dp/d[w; v] = L = [-hat(p), I].
void add_sandwich(const Eigen::Vector3d& p, const Matrix3d& A, Matrix6d& sum) {
  const Matrix3d PA = cross(p, A);
  const Matrix3d minus_AP = cross(p, A.transpose()).transpose();
  sum.topLeftCorner<3, 3>() += cross(p, PA.transpose()).transpose();
  sum.topRightCorner<3, 3>() += PA;
  sum.bottomLeftCorner<3, 3>() += minus_AP;
  sum.bottomRightCorner<3, 3>() += A;
}

Matrix6d symmetric(const Matrix6d& M) {
  return 0.5 * (M + M.transpose());
}

/// Information of a prior that every pose has.
Matrix6d widest() {
  return left_information(kWidestTurn, kWidest).asDiagonal();
}

Matrix6d inverse_of(const Matrix6d& information) {
  return (information + widest()).llt().solve(Matrix6d::Identity());
}

/// Sums over the landmarks.
struct Sums {
  Matrix6d hessian = Matrix6d::Zero(), hessian_before = Matrix6d::Zero();
  Matrix6d noise = Matrix6d::Zero();  // of the frame
  // Covariance of both gradients by errors of the landmarks.
  Matrix6d here = Matrix6d::Zero(), both = Matrix6d::Zero(), before = Matrix6d::Zero();
  // Derivatives of the gradients by the errors of keyframes, and information about these: blocks
  // of the lower triangle, row by row.
  std::vector<Matrix6d> by_keyframe, before_by_keyframe, keyframes;
};

class Summation {
 public:
  explicit Summation(const PoseCovarianceProblem& problem) : problem_(problem) {
    const auto count = static_cast<std::size_t>(problem.keyframes);
    sums_.by_keyframe.assign(count, Matrix6d::Zero());
    sums_.before_by_keyframe.assign(count, Matrix6d::Zero());
    sums_.keyframes.assign(count * (count + 1) / 2, Matrix6d::Zero());
  }

  Sums take() {
    for (const Landmark& landmark : problem_.landmarks) add(landmark);
    return std::move(sums_);
  }

 private:
  void add(const Landmark& l) {
    const bool is_before = !l.weight_before.isZero(0);
    add_sandwich(l.p, l.weight, sums_.hessian);
    if (is_before) add_sandwich(l.p, l.weight_before, sums_.hessian_before);
    if (!(l.stands_for > 0)) return;
    add_sandwich(l.p, l.stands_for * l.noise, sums_.noise);
    const std::span<const View> views(problem_.views.data() + l.first_view, l.views);
    Matrix3d information = problem_.accepted * (l.weight + l.weight_before);
    information.diagonal().array() += 1 / (kFarthest * kFarthest);
    for (const View& view : views) information += view.information;
    const Matrix3d covariance = information.inverse();
    const Matrix3d gain = l.stands_for * l.weight * covariance;
    add_sandwich(l.p, gain * l.weight, sums_.here);
    const Matrix3d gain_before = l.stands_for * l.weight_before * covariance;
    if (is_before) {
      add_sandwich(l.p, gain * l.weight_before, sums_.both);
      add_sandwich(l.p, gain_before * l.weight_before, sums_.before);
    }
    for (const View& view : views) {
      const auto k = static_cast<std::size_t>(view.keyframe);
      add_sandwich(l.p, gain * view.information, sums_.by_keyframe[k]);
      if (is_before) add_sandwich(l.p, gain_before * view.information, sums_.before_by_keyframe[k]);
      add_pairs(l, view, views, l.stands_for * covariance);
    }
  }

  /// The Schur complement of the landmark: one view with itself and those of earlier keyframes.
  void add_pairs(const Landmark& l, const View& view, std::span<const View> views,
                 const Matrix3d& covariance) {
    const Matrix3d gain = view.information * covariance;
    const auto row = static_cast<std::size_t>(view.keyframe);
    for (const View& other : views) {
      if (other.keyframe > view.keyframe) continue;
      Matrix3d A = -gain * other.information;
      if (other.keyframe == view.keyframe) A += l.stands_for * view.information;
      const auto column = static_cast<std::size_t>(other.keyframe);
      add_sandwich(l.p, A, sums_.keyframes[row * (row + 1) / 2 + column]);
    }
  }

  const PoseCovarianceProblem& problem_;
  Sums sums_;
};

using RowOfBlocks = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// M times each of the blocks, side by side.
RowOfBlocks times(const Matrix6d& M, const std::vector<Matrix6d>& blocks) {
  RowOfBlocks row(6, 6 * static_cast<Eigen::Index>(blocks.size()));
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    row.middleCols<6>(6 * static_cast<Eigen::Index>(k)) = M * blocks[k];
  }
  return row;
}

/// Errors of keyframes relative to the reference, as a factor F with covariance F^T F.
class KeyframeErrors {
 public:
  KeyframeErrors(const Sums& sums, int reference) : reference_(reference) {
    const auto count = static_cast<Eigen::Index>(sums.by_keyframe.size());
    Eigen::MatrixXd information(6 * count, 6 * count);
    for (Eigen::Index row = 0, at = 0; row < count; ++row) {
      for (Eigen::Index column = 0; column <= row; ++column, ++at) {
        information.block<6, 6>(6 * row, 6 * column) = sums.keyframes[static_cast<std::size_t>(at)];
      }
      // Every keyframe sees other landmarks too.
      information.block<6, 6>(6 * row, 6 * row) += kOtherLandmarks * sums.hessian;
    }
    information.diagonal().array() += 1 / (kWidest * kWidest);
    information.middleRows<6>(6 * reference).setZero();
    information.middleCols<6>(6 * reference).setZero();
    information.block<6, 6>(6 * reference, 6 * reference).setIdentity();
    factor_.compute(information);
  }

  /// C P C^T of a linear function C of the errors.
  Matrix6d covariance_of(RowOfBlocks C) const {
    C.middleCols<6>(6 * reference_).setZero();
    // By columns: Eigen splits the sums of several at once by the size of the processor's cache.
    Eigen::MatrixXd root = C.transpose();
    for (Eigen::Index i = 0; i < root.cols(); ++i) factor_.matrixL().solveInPlace(root.col(i));
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
    Matrix6d sum = XA * (sums.noise + sums.here + widest()) * XA.transpose();
    RowOfBlocks by_keyframe = times(XA, sums.by_keyframe);
    if (is_keyframe) {
      by_keyframe.middleCols<6>(6 * problem.before->keyframe) += Y;
    } else if (has_before) {
      const Matrix6d YA = Y * A_before;
      const Matrix6d both = XA * sums.both * YA.transpose();
      sum += both + both.transpose();
      sum += YA * (problem.before->noise + sums.before + widest()) * YA.transpose();
      by_keyframe += times(YA, sums.before_by_keyframe);
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
  result.noise = symmetric(sums.noise);
  if (!problem.prior.isZero(0)) {
    const Matrix6d of_prior = problem.prior_error + covariance_of(Matrix6d::Zero(), identity);
    result.noise += symmetric(problem.prior * of_prior * problem.prior);
  }
  return result;
}

}  // namespace kys_slam
