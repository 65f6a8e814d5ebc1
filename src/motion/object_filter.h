// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "motion/object_tracks.h"

/// The filter of one object: constant velocity with white acceleration, forward and backward.
namespace kys_slam::objects {

using Covariance = Eigen::Matrix<double, 6, 6>;

/// Position (m) and velocity (m/s) in the world.
struct Gaussian {
  Eigen::Matrix<double, 6, 1> mean = Eigen::Matrix<double, 6, 1>::Zero();
  Covariance covariance = Covariance::Zero();
};

/// The state `dt` s later.
/// \param density of the white acceleration, m^2/s^3
Gaussian predict(const Gaussian& from, double dt, double density);

/// Takes in an observation of the position or of the velocity.
void observe_position(Gaussian& state, const Eigen::Vector3d& value, const Eigen::Matrix3d& R);
void observe_velocity(Gaussian& state, const Eigen::Vector3d& value, const Eigen::Matrix3d& R);

/// An observation in the axes of the world: a position (m) or a velocity (m/s).
struct Observed {
  Eigen::Vector3d value;
  Eigen::Matrix3d covariance;
};
Observed world_place(const ObjectFrame& frame, const ObservedPlace& seen,
                     const ObjectTrackOptions& options);
Observed world_velocity(const ObjectFrame& frame, const ObservedVelocity& seen,
                        const ObjectTrackOptions& options);

/// What is observed of a track, per frame in which it is seen.
struct TrackData {
  std::vector<double> times;                      // s
  std::vector<std::optional<Observed>> places;    // m, one at least
  std::vector<std::vector<Observed>> velocities;  // m/s, each in the middle of its span
};

/// The states at all times, from all observations (Rauch, Tung, Striebel), where some are wrong:
/// each counts the less the farther it is from the states that all give together (weights of Geman
/// and McClure). Of an object that comes into view the edge of what hides it is seen first, and
/// moves otherwise.
std::vector<Gaussian> smooth_robustly(const TrackData& data, const ObjectTrackOptions& options);

}  // namespace kys_slam::objects
