// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>

#include <Eigen/Core>

namespace kys_slam {

/// Points nearer than this (m) are taken as this far away.
inline constexpr double kNearest = 0.05;

/// What a rig measures of a point, px of the images as given, and the derivatives.
struct Prediction {
  using Vector = Eigen::Vector4d;
  Vector value = Vector::Zero();  ///< u, v, disparity, row of the right image less that of the left
  Eigen::Matrix<double, 4, 3> by_point = Eigen::Matrix<double, 4, 3>::Zero();  ///< px/m
  Eigen::Matrix<double, 4, RigCorrection::kSize> by_rig =
      Eigen::Matrix<double, 4, RigCorrection::kSize>::Zero();
};

/// \param p_c of the point in the left camera frame, m
/// \param derivatives whether they are wanted; they take most of the time
Prediction predict(const StereoCamera& given, const RigCorrection& rig, const Eigen::Vector3d& p_c,
                   bool derivatives);

}  // namespace kys_slam
