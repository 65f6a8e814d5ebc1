// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rectifier.h>

#include <Eigen/Core>
#include <optional>

namespace kys_slam {

/// Raw pixel of a ray (camera frame, any length) in a camera with its distortion, or nothing where
/// the lens model does not reach.
std::optional<Eigen::Vector2d> project(const RawCamera& camera, const Eigen::Vector3d& ray);

/// Inverse of project() for a radial-tangential lens, on the plane z = 1: five fixed-point
/// iterations, as OpenCV's undistortPoints() does by default.
Eigen::Vector2d undistorted(const RawCamera& camera, double u, double v);

}  // namespace kys_slam
