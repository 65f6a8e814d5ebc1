#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace kys_slam {

/// A moving thing in one frame, from its stereo keypoints. The position belongs to a point that
/// stays on the thing (near the middle of what was seen of it), not to the middle of its box.
/// Position and velocity are smoothed over the whole time for which the thing was followed.
struct ObjectEstimate {
  std::int64_t frame = 0;     ///< index of the frame, as fed: 0, 1, ...
  std::int32_t instance = 0;  ///< identity over time; the first one its priors gave it, if free
  std::uint16_t label = 0;    ///< class index in the label space of the priors
  double p_moving = 0;        ///< 0..1
  int keypoints = 0;          ///< stereo keypoints on it in this frame
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< m, in the frame of the trajectory
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s, in the frame of the trajectory
  Eigen::Matrix3d velocity_covariance = Eigen::Matrix3d::Zero();  ///< m^2/s^2
};

}  // namespace kys_slam
