// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <optional>
#include <span>

namespace kys_slam {

/// p_a = scale * R p_b + t, R and t those of T.
struct PointAlignment {
  double scale = 1;
  Rigid3 T;
};

/// The alignment with least sum of weights * |points_a - (scale * R * points_b + t)|^2 (Umeyama,
/// PAMI 1991); points in m. `weights` is empty (all one) or has one non-negative value per point.
/// The scale is 1 unless `with_scale`. Nothing if there are fewer than three points, if they lie on
/// a line (second singular value at most `min_spread` times the first), or if one is not finite.
/// \throws std::invalid_argument if the lengths differ.
std::optional<PointAlignment> align_points(std::span<const Eigen::Vector3d> points_a,
                                           std::span<const Eigen::Vector3d> points_b,
                                           std::span<const double> weights, bool with_scale,
                                           double min_spread);

/// The same without scale: T_a_b.
std::optional<Rigid3> absolute_orientation(std::span<const Eigen::Vector3d> points_a,
                                           std::span<const Eigen::Vector3d> points_b,
                                           std::span<const double> weights = {});

}  // namespace kys_slam
