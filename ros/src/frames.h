// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/report.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/ros_covariance.h>

#include <cstdint>
#include <map>
#include <optional>

namespace kys_slam::ros {

/// Optical axes (x right, y down, z forward) to those of a body (REP 103: x forward, y left, z up).
Rigid3 optical_to_body();

/// Where the left camera is on the robot. \param position m \param rpy rad, rotation about x, then
/// y, then z of base_link, as of static_transform_publisher; of the camera's body axes
/// \return T_base_camera of the optical frame
Rigid3 base_from_camera(const Eigen::Vector3d& position, const Eigen::Vector3d& rpy);

/// A transform as ROS has it. \param xyzw quaternion
/// \throws InputError when a number is not finite, or the quaternion is not of length 1 (to 1e-3)
Rigid3 rigid_of(const Eigen::Vector3d& position, const Eigen::Vector4d& xyzw);

/// Pose and velocity of one frame in ROS's frames.
struct FramePoses {
  Rigid3 T_map_odom, T_odom_base, T_map_base;
  RosCovariance covariance{};     ///< of T_odom_base; zero: not known
  std::optional<RosTwist> twist;  ///< in base_link
};

/// Poses of the tracker in the frames of REP 105. `odom` moves with the measured motion between
/// frames alone, so that it is continuous; after lost frames, whose motion nobody measured, it goes
/// on where it was. All corrections (loops, merged sub-maps, relocalisation) are in map to odom.
///
/// `map` is base_link at the first frame, with its axes: z is up where base_link was level. A
/// sub-map that starts later goes on at the last pose until it is merged.
class Rep105Frames {
 public:
  explicit Rep105Frames(const Rigid3& T_base_camera) : T_base_camera_(T_base_camera) {}

  /// Nothing for a lost frame.
  std::optional<FramePoses> add(const FrameReport& report);

 private:
  const Rigid3& world_of(const FrameReport& report);
  [[nodiscard]] std::optional<RelativePose> motion_of(const FrameReport& report) const;

  struct Last {
    std::int64_t index = 0;
    double timestamp = 0;  // s
    std::int64_t submap = -1;
    Rigid3 T_w_c, T_map_c, T_odom_c;
  };
  Rigid3 T_base_camera_;
  std::map<std::int64_t, Rigid3> T_map_w_;  // by sub-map
  std::optional<Last> last_;                // frame with a pose
};

/// The same motion or uncertainty, of base_link in place of the camera: increments on the right.
RelativePose of_base(const RelativePose& of_camera, const Rigid3& T_base_camera);

}  // namespace kys_slam::ros
