// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/absolute_orientation.h"

#include <Eigen/SVD>
#include <stdexcept>

namespace kys_slam {

std::optional<PointAlignment> align_points(std::span<const Eigen::Vector3d> points_a,
                                           std::span<const Eigen::Vector3d> points_b,
                                           std::span<const double> weights, bool with_scale,
                                           double min_spread) {
  const std::size_t count = points_a.size();
  if (points_b.size() != count || (!weights.empty() && weights.size() != count)) {
    throw std::invalid_argument("align_points: arrays differ in length");
  }
  if (count < 3) return std::nullopt;
  const auto weight = [&](std::size_t i) { return weights.empty() ? 1.0 : weights[i]; };

  double total = 0;
  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    total += weight(i);
    mean_a += weight(i) * points_a[i];
    mean_b += weight(i) * points_b[i];
  }
  if (!(total > 0)) return std::nullopt;
  mean_a /= total;
  mean_b /= total;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    covariance += weight(i) * (points_a[i] - mean_a) * (points_b[i] - mean_b).transpose();
  }
  if (!covariance.allFinite()) return std::nullopt;

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  // Two directions have to be told apart; the third follows from handedness.
  const Eigen::Vector3d& s = svd.singularValues();
  if (!(s[1] > min_spread * s[0]) || s[0] <= 0) return std::nullopt;
  Eigen::Matrix3d U = svd.matrixU();
  const bool mirrored = U.determinant() * svd.matrixV().determinant() < 0;
  if (mirrored) U.col(2) = -U.col(2);
  const Rigid3 rotation(Eigen::Matrix3d(U * svd.matrixV().transpose()), Eigen::Vector3d::Zero());
  PointAlignment result;
  if (with_scale) {
    double spread_b = 0;
    for (std::size_t i = 0; i < count; ++i) {
      spread_b += weight(i) * (points_b[i] - mean_b).squaredNorm();
    }
    result.scale = (s[0] + s[1] + (mirrored ? -s[2] : s[2])) / spread_b;
  }
  result.T = Rigid3(rotation.rotation, mean_a - result.scale * (rotation * mean_b));
  return result;
}

std::optional<Rigid3> absolute_orientation(std::span<const Eigen::Vector3d> points_a,
                                           std::span<const Eigen::Vector3d> points_b,
                                           std::span<const double> weights) {
  constexpr double kMinSpread = 1e-10;
  const auto aligned = align_points(points_a, points_b, weights, false, kMinSpread);
  if (!aligned) return std::nullopt;
  return aligned->T;
}

}  // namespace kys_slam
