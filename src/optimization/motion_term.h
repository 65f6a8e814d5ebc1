// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <cstdint>

namespace kys_slam {

/// Expected motion between two poses of a bundle problem: T_a_b is Gaussian about its expected
/// value, an additional term of the cost.
struct MotionTerm {
  std::uint32_t a = 0;  ///< pose
  std::uint32_t b = 0;  ///< another pose
  Rigid3 T_a_b;
  double sigma_position = 1;  ///< m
  double sigma_rotation = 1;  ///< rad
};

/// 1/2 of its chi-square at two poses.
double cost_of(const MotionTerm& term, const Rigid3& T_a_w, const Rigid3& T_b_w);

/// Blocks of the normal equations by the increments of plus_left(), rotation first.
struct MotionNormal {
  using Matrix6d = Eigen::Matrix<double, 6, 6>;
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  Matrix6d aa, ab, bb;
  Vector6d a, b;  ///< gradients
};
MotionNormal normal_of(const MotionTerm& term, const Rigid3& T_a_w, const Rigid3& T_b_w);

}  // namespace kys_slam
