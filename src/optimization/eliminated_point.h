// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "geometry/damping.h"
#include "optimization/schur_kernels.h"

namespace kys_slam {

/// What back-substitution and the gain ratio need of an eliminated point.
struct EliminatedPoint {
  std::array<double, 6> L_inverse;  // of the Cholesky factor of V + damping: lower triangle by rows
  Eigen::Vector3d b;                // J^T W r
  Eigen::Vector3d damping;          // what was added to the diagonal of V
};

/// The lower triangle is all that is read.
template <typename Six>
Eigen::Matrix3d lower_of(const Six& n) {
  Eigen::Matrix3d lower;
  lower << n[0], 0, 0, n[1], n[2], 0, n[3], n[4], n[5];
  return lower;
}

/// Inverse of the lower Cholesky factor of a positive definite 3x3 matrix.
inline Eigen::Matrix3d inverse_of_cholesky(const Eigen::Matrix3d& V) {
  const double l00 = std::sqrt(V(0, 0));
  const double i00 = 1.0 / l00;
  const double l10 = V(1, 0) * i00;
  const double l20 = V(2, 0) * i00;
  const double i11 = 1.0 / std::sqrt(V(1, 1) - l10 * l10);
  const double l21 = (V(2, 1) - l20 * l10) * i11;
  const double i22 = 1.0 / std::sqrt(V(2, 2) - l20 * l20 - l21 * l21);
  Eigen::Matrix3d inverse;
  inverse << i00, 0, 0, -l10 * i00 * i11, i11, 0, (l10 * l21 * i11 - l20) * i00 * i22,
      -l21 * i11 * i22, i22;
  return inverse;
}

inline EliminatedPoint eliminated(const schur::PointNormal& normal, double damping) {
  EliminatedPoint e;
  Eigen::Matrix3d V = lower_of(normal.V);
  e.b = Eigen::Vector3d(normal.b);
  e.damping = damping * V.diagonal().cwiseMax(Damping::kMinDiagonal);
  V.diagonal() += e.damping;
  const Eigen::Matrix3d L = inverse_of_cholesky(V);
  e.L_inverse = {L(0, 0), L(1, 0), L(1, 1), L(2, 0), L(2, 1), L(2, 2)};
  return e;
}

}  // namespace kys_slam
