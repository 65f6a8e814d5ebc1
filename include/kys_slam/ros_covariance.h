// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/report.h>

#include <array>
#include <optional>

namespace kys_slam {

/// Row-major 6x6 matrix in the order of ROS's messages: x, y, z, rotation about x, y, z.
using RosCovariance = std::array<double, 36>;

/// [rotation; translation] to [translation; rotation], both turned by R.
inline RosCovariance ros_order(const RelativePose::Covariance& covariance,
                               const Eigen::Matrix3d& R = Eigen::Matrix3d::Identity()) {
  RelativePose::Covariance change = RelativePose::Covariance::Zero();
  change.topRightCorner<3, 3>() = R;
  change.bottomLeftCorner<3, 3>() = R;
  const RelativePose::Covariance turned = change * covariance * change.transpose();
  RosCovariance result{};
  for (int i = 0; i < 36; ++i) {
    result[static_cast<std::size_t>(i)] = 0.5 * (turned(i / 6, i % 6) + turned(i % 6, i / 6));
  }
  return result;
}

/// For PoseWithCovariance of T_w_c: REP 103 has both errors about the fixed axes of the header's
/// frame, here w. \param covariance of an increment on the right of T_w_c (RelativePose)
inline RosCovariance ros_pose_covariance(const RelativePose::Covariance& covariance,
                                         const Rigid3& T_w_c) {
  return ros_order(covariance, T_w_c.R());
}

/// For TwistWithCovariance, in the child frame: the left camera.
struct RosTwist {
  Eigen::Vector3d linear;   ///< m/s
  Eigen::Vector3d angular;  ///< rad/s
  RosCovariance covariance{};
};

/// The mean velocity of a motion, as constant in the frame of the camera.
/// \param seconds that it took; without a positive time there is none
inline std::optional<RosTwist> ros_twist(const RelativePose& motion, double seconds) {
  if (!(seconds > 0)) return std::nullopt;
  const Eigen::Vector3d w = so3_log(motion.T_other_c.rotation);
  RosTwist twist;
  // The axes in the middle of the motion.
  twist.linear = so3_exp(-0.5 * w) * motion.T_other_c.translation / seconds;
  twist.angular = w / seconds;
  twist.covariance = ros_order(motion.covariance / (seconds * seconds));
  return twist;
}

}  // namespace kys_slam
