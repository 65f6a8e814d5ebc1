#pragma once

#include <kys_slam/rigid3.h>

#include <optional>
#include <span>

namespace kys_slam {

/// The rigid motion with least sum of weights * |points_a - T_a_b * points_b|^2 (Horn 1987,
/// Umeyama 1991, scale one). `weights` may be empty (all one); otherwise non-negative, one each.
/// Nothing if there are fewer than three points, or they lie on a line, or one is not finite.
/// \throws std::invalid_argument if the lengths differ.
std::optional<Rigid3> absolute_orientation(std::span<const Eigen::Vector3d> points_a,
                                           std::span<const Eigen::Vector3d> points_b,
                                           std::span<const double> weights = {});

}  // namespace kys_slam
