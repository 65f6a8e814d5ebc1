// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace kys_slam {

/// A moving object in one frame, estimated from its stereo keypoints. The position is that of a
/// point fixed to the object, near the centre of its visible part; it is not the centre of a box.
/// Position and velocity are smoothed over the whole track.
struct ObjectEstimate {
  std::int64_t frame = 0;     ///< index of the frame, as fed: 0, 1, ...
  std::int32_t instance = 0;  ///< identity over time: the first one in its priors, if not used
  std::uint16_t label = 0;    ///< class index in the label space of the priors
  double p_moving = 0;        ///< 0..1
  int keypoints = 0;          ///< stereo keypoints on it in this frame; 0: predicted
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< m, in the frame of the trajectory
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s, in the frame of the trajectory
  Eigen::Matrix3d velocity_covariance = Eigen::Matrix3d::Zero();  ///< m^2/s^2
};

}  // namespace kys_slam
