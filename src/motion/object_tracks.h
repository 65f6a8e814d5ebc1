// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/object.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace kys_slam {

/// Velocity of an object in the world between an earlier frame and this one, in the axes of the
/// camera now.
struct ObservedVelocity {
  Eigen::Vector3d velocity_c = Eigen::Vector3d::Zero();  ///< m/s
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< m^2/s^2
  double span = 0;                                       ///< s between the two frames
};

/// Position of the centre of an object's keypoints, in the camera frame.
struct ObservedPlace {
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();    ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< m^2
};

/// Observation of a moving object in one frame. Without a comparison to an earlier frame it has
/// neither position nor velocity.
struct ObjectObservation {
  std::int32_t instance = 0;  ///< instance of the priors
  std::uint16_t label = 0;
  double p_moving = 0;
  int keypoints = 0;  ///< stereo keypoints on it
  /// it may be static, or shows too little: it has no position, and does not count for
  /// min_observations
  bool doubtful = false;
  bool unlikely = false;  ///< doubtful, and kept only between frames that are not unlikely
  std::optional<ObservedPlace> place;
  std::optional<ObservedVelocity> velocity;
};

/// One frame of the recording, in order of time.
struct ObjectFrame {
  double taken = 0;             ///< s, when its image was taken
  std::optional<Rigid3> T_w_c;  ///< final pose; nothing: the frame is skipped
  std::vector<ObjectObservation> observations;
};

struct ObjectTrackOptions {
  double acceleration_density = 1.0;  ///< m^2/s^3, of the white acceleration of the motion model
  double start_speed = 15;            ///< m/s, standard deviation of the initial velocity
  double surface_sigma = 1.0;         ///< m, standard deviation of the centre of the visible part
  double speed_sigma = 0.05;          ///< m/s, added to every observed velocity
  double gate = 2.0;                  ///< m, largest distance of an observation from its prediction
  double gate_growth = 3.0;           ///< m/s, growth of the gate without observations
  /// m, gate for an observation of the same instance; its filter restarts
  double restart_gate = 8.0;
  /// of the same instance one after the other, outside of the gate, from which the filter restarts.
  /// One or two are mostly a centre that is on the background for a moment
  int restart_observations = 3;
  /// of two parts of a track with a restart between them, share of the other's keypoints per frame
  /// below which a short part takes the motion of the other
  double restart_share = 0.5;
  double max_gap = 1.0;  ///< s without an observation after which a track ends
  /// s, largest extent of a track before the first and after the last observation of its position
  double max_extrapolation = 0.5;
  int min_observations = 3;  ///< a track with fewer is dropped
};
/// For check_options().
void describe(kys::OptionList& list, ObjectTrackOptions& options);

/// Tracks moving objects over time. Observations are assigned to tracks by position and instance.
/// An object that jumps for a moment keeps its motion, one that does for `restart_observations`
/// and keeps its instance keeps its identity, with a new filter. A part of up
/// to `max_extrapolation` before or after a jump that has few keypoints takes the motion of the
/// other part: of an object that comes into view, the edge of what hides it is seen first. Each
/// track is a Kalman filter of constant velocity (position and velocity with covariance), smoothed
/// at the end, where observations far from the smoothed states count less. A velocity observed over
/// a span is that of the middle of the span. Camera poses are taken as exact. A pure function.
/// \return one estimate per observation, by frame, then instance
std::vector<ObjectEstimate> track_objects(std::span<const ObjectFrame> frames,
                                          const ObjectTrackOptions& options = {});

}  // namespace kys_slam
