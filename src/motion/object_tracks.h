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

/// How fast a thing was between an earlier frame and this one, in the axes of the camera now; the
/// camera's own motion is taken out.
struct ObservedVelocity {
  Eigen::Vector3d velocity_c = Eigen::Vector3d::Zero();  ///< m/s
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< m^2/s^2
  double span = 0;                                       ///< s between the two frames
};

/// Where the middle of a thing's keypoints is.
struct ObservedPlace {
  Eigen::Vector3d centre_c = Eigen::Vector3d::Zero();    ///< m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< m^2
};

/// What one frame shows of a thing that is believed to move. One that could not be compared with an
/// earlier frame has a name and neither place nor velocity.
struct ObjectObservation {
  std::int32_t instance = 0;  ///< as the priors name it
  std::uint16_t label = 0;
  double p_moving = 0;
  int keypoints = 0;  ///< stereo keypoints on it
  std::optional<ObservedPlace> place;
  std::optional<ObservedVelocity> velocity;
};

/// One frame of the recording, in order of time.
struct ObjectFrame {
  double timestamp = 0;         ///< s
  std::optional<Rigid3> T_w_c;  ///< final pose; nothing: the frame has none, and is left out
  std::vector<ObjectObservation> observations;
};

struct ObjectTrackOptions {
  double acceleration_density = 1.0;  ///< m^2/s^3, of the white acceleration of the motion model
  double start_speed = 15;            ///< m/s, standard deviation of a speed not seen yet
  double surface_sigma = 1.0;         ///< m, by which the middle of what is seen of a thing wanders
  double speed_sigma = 0.05;          ///< m/s, added to every observed velocity
  double gate = 2.0;                  ///< m, at most between a thing and where it was expected
  double gate_growth = 3.0;           ///< m/s, by which that grows while it is not seen
  double restart_gate = 8.0;          ///< m, the same for a thing of the same name that jumped
  double max_gap = 1.0;               ///< s without an observation after which a track ends
  int min_observations = 3;           ///< a track with fewer is dropped
};
/// For check_options().
void describe(kys::OptionList& list, ObjectTrackOptions& options);

/// Follows moving things over time: observations are assigned to tracks by place and name. A thing
/// that jumps but keeps its name goes on under the same identity with a new filter. Each track is a
/// filter of constant velocity (position and velocity with covariance), smoothed at the end. A
/// velocity observed over a span says what the speed was in its middle. The camera's poses are
/// taken as exact. A pure function. \return one estimate per observation, by frame, then instance.
std::vector<ObjectEstimate> track_objects(std::span<const ObjectFrame> frames,
                                          const ObjectTrackOptions& options = {});

}  // namespace kys_slam
