// SPDX-License-Identifier: BSD-3-Clause
#include "frames.h"

#include <kys_slam/error.h>

#include <cmath>

namespace kys_slam::ros {

Rigid3 optical_to_body() {
  Eigen::Matrix3d R;
  R << 0, 0, 1,  //
      -1, 0, 0,  //
      0, -1, 0;
  return {R, Eigen::Vector3d::Zero()};
}

Rigid3 base_from_camera(const Eigen::Vector3d& position, const Eigen::Vector3d& rpy) {
  const Eigen::Quaterniond q =
      so3_exp({0, 0, rpy.z()}) * so3_exp({0, rpy.y(), 0}) * so3_exp({rpy.x(), 0, 0});
  return Rigid3(q, position) * optical_to_body();
}

Rigid3 rigid_of(const Eigen::Vector3d& position, const Eigen::Vector4d& xyzw) {
  constexpr double kTolerance = 1e-3;
  if (!position.allFinite() || !xyzw.allFinite()) {
    throw InputError("a transform has numbers that are not finite");
  }
  if (std::abs(xyzw.norm() - 1) > kTolerance) {
    throw InputError("a transform has a quaternion of length " + std::to_string(xyzw.norm()) +
                     ", not 1");
  }
  return {Eigen::Quaterniond(xyzw.w(), xyzw.x(), xyzw.y(), xyzw.z()), position};
}

RelativePose of_base(const RelativePose& of_camera, const Rigid3& T_base_camera) {
  // T exp(d) T_c_b = T T_c_b exp(Ad d) with the adjoint of T_b_c, d = [rotation; translation].
  RelativePose::Covariance adjoint = RelativePose::Covariance::Zero();
  const Eigen::Matrix3d R = T_base_camera.R();
  adjoint.topLeftCorner<3, 3>() = R;
  adjoint.bottomRightCorner<3, 3>() = R;
  adjoint.bottomLeftCorner<3, 3>() = hat(T_base_camera.t()) * R;
  return {of_camera.other, T_base_camera * of_camera.T_other_c * T_base_camera.inverse(),
          adjoint * of_camera.covariance * adjoint.transpose()};
}

/// T_map_w of the frame's sub-map.
const Rigid3& Rep105Frames::world_of(const FrameReport& report) {
  const auto known = T_map_w_.find(report.submap);
  if (known != T_map_w_.end()) return known->second;
  const bool goes_on = report.status == FrameStatus::kStarted && last_;
  const Rigid3 T_map_w = goes_on ? last_->T_map_c * report.T_w_c.inverse() : T_base_camera_;
  return T_map_w_.emplace(report.submap, T_map_w).first->second;
}

/// Since the last frame with a pose; nothing when it was not measured.
std::optional<RelativePose> Rep105Frames::motion_of(const FrameReport& report) const {
  if (!last_ || report.status == FrameStatus::kStarted || report.relocalised) return std::nullopt;
  if (report.motion && report.motion->other == last_->index) return report.motion;
  if (report.submap != last_->submap) return std::nullopt;
  RelativePose motion;  // of unknown covariance; a correction of the map since is part of it
  motion.other = last_->index;
  motion.T_other_c = last_->T_w_c.inverse() * report.T_w_c;
  return motion;
}

std::optional<FramePoses> Rep105Frames::add(const FrameReport& report) {
  if (report.status == FrameStatus::kLost) return std::nullopt;
  const std::optional<RelativePose> motion = motion_of(report);
  Last now{report.index, report.timestamp, report.submap, report.T_w_c, {}, {}};
  now.T_map_c = world_of(report) * report.T_w_c;
  now.T_odom_c = last_ ? last_->T_odom_c : T_base_camera_;
  if (motion) now.T_odom_c = now.T_odom_c * motion->T_other_c;

  FramePoses poses;
  const Rigid3 T_camera_base = T_base_camera_.inverse();
  poses.T_odom_base = now.T_odom_c * T_camera_base;
  poses.T_map_base = now.T_map_c * T_camera_base;
  poses.T_map_odom = poses.T_map_base * poses.T_odom_base.inverse();
  if (report.local) {
    poses.covariance =
        ros_pose_covariance(of_base(*report.local, T_base_camera_).covariance, poses.T_odom_base);
  }
  if (motion && report.motion) {
    poses.twist = ros_twist(of_base(*motion, T_base_camera_), report.timestamp - last_->timestamp);
  }
  last_ = now;
  return poses;
}

}  // namespace kys_slam::ros
