// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <builtin_interfaces/msg/time.hpp>
#include <diagnostic_msgs/msg/diagnostic_status.hpp>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/transform_stamped.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rclcpp/parameter_value.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/image.hpp>
#include <string>

#include "node_logic.h"

/// ROS's messages from and to those of the logic. Nothing is decided here.
namespace kys_slam::ros {

ImageMessage from_ros(const sensor_msgs::msg::Image::ConstSharedPtr& message);
/// \throws InputError unless it is a rigid transformation
Rigid3 from_ros(const geometry_msgs::msg::Transform& transform);
CameraInfo from_ros(const sensor_msgs::msg::CameraInfo& message);

builtin_interfaces::msg::Time to_ros(const Stamp& stamp);
geometry_msgs::msg::Pose to_ros(const Rigid3& T_a_b);
geometry_msgs::msg::TransformStamped transform_of(const Rigid3& T_a_b, const Stamp& stamp,
                                                  const std::string& a, const std::string& b);
nav_msgs::msg::Odometry odometry_of(const PoseOutput& pose, const NodeOptions& options);
geometry_msgs::msg::PoseStamped pose_of(const PoseOutput& pose, const NodeOptions& options);
diagnostic_msgs::msg::DiagnosticStatus to_ros(const Diagnostics& diagnostics,
                                              const std::string& name);

rcl_interfaces::msg::ParameterDescriptor descriptor_of(const Parameter& parameter);
rclcpp::ParameterValue default_of(const Parameter& parameter);
/// Numbers in the shortest form that reads back as the same number.
std::string text_of(const rclcpp::ParameterValue& value);

}  // namespace kys_slam::ros
