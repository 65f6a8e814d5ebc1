// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace kys_slam {

/// Everything a pose was estimated from, for the covariance of its error. All quantities are
/// expressed in the frame of the camera ("here"). The errors of all poses, of the frame, the frame
/// before and keyframes, are increments [w; v] (rad, m) here: T_here_w -> plus_left(T_here_w, d)
/// for the frame, T_k_here -> T_k_here plus_left(I, d) for another one. docs/pose_quality.md has
/// the derivation.
struct PoseCovarianceProblem {
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  /// Information (1/m^2) about a landmark from one keyframe.
  struct View {
    int keyframe = 0;
    Eigen::Matrix3d information;
  };
  /// A landmark that the frame or the frame before observes.
  struct Landmark {
    Eigen::Vector3d p = Eigen::Vector3d::Zero();  ///< m
    /// Information (1/m^2) with which it counts in the frame's normal equations; zero: not at all.
    Eigen::Matrix3d weight = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d weight_before = Eigen::Matrix3d::Zero();  ///< the same of the frame before
    /// Covariance of weight times the shift of the landmark by the frame's own noise, 1/m^2.
    Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();
    /// As many landmarks as this one stands for in sums of errors: a sample of them is enough.
    /// Zero: it counts in the normal equations only.
    double stands_for = 1;
    std::uint32_t first_view = 0;
    std::uint32_t views = 0;
  };
  std::vector<Landmark> landmarks;
  std::vector<View> views;
  /// The test for outliers bounds the error of a landmark: in addition to its views it is known by
  /// this share of the information with which it counts. It matters where views do not measure
  /// depth.
  double accepted = 0;
  int keyframes = 0;  ///< poses with views
  int reference = 0;  ///< keyframe whose pose is exact

  /// Prior of the frame's pose (PosePrior): its information, and the covariance of its error beyond
  /// that of the frame before.
  Matrix6d prior = Matrix6d::Zero();
  Matrix6d prior_error = Matrix6d::Zero();

  /// The frame before: one of the keyframes (>= 0), or what its own noise and prior were.
  struct Before {
    int keyframe = -1;
    Matrix6d noise = Matrix6d::Zero();  ///< gradient's covariance by its own noise and prior
    Matrix6d prior = Matrix6d::Zero();  ///< information of its prior
  };
  std::optional<Before> before;
};

struct PoseCovarianceResult {
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  Matrix6d pose;                   ///< of the frame relative to the reference keyframe
  std::optional<Matrix6d> motion;  ///< of the frame relative to the frame before
  /// Of the frame: covariance of the gradient by its own noise and prior, for
  /// PoseCovarianceProblem::Before::noise of the next one.
  Matrix6d noise;
  /// Covariance of the frame's gradient by its own noise and that of the landmarks alone, and
  /// inverse of its Hessian: what the residuals can be compared with.
  Matrix6d gradient;
  Matrix6d inverse;
};

/// Covariances of the pose and of the motion. Both are symmetric and positive definite.
PoseCovarianceResult pose_covariance(const PoseCovarianceProblem& problem);

}  // namespace kys_slam
