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

/// The motion with least sum of weights * |points_a - (scale * R * points_b + t)|^2 (Umeyama, PAMI
/// 1991). `weights` may be empty (all one); otherwise non-negative, one each. The scale stays one
/// unless asked for. Nothing if there are fewer than three points, or they lie on a line (their
/// second singular value is no more than `min_spread` of the first), or one is not finite.
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
