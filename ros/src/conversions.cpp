// SPDX-License-Identifier: BSD-3-Clause
#include "conversions.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>

namespace kys_slam::ros {

ImageMessage from_ros(const sensor_msgs::msg::Image::ConstSharedPtr& message) {
  ImageMessage image;
  image.stamp = {message->header.stamp.sec, message->header.stamp.nanosec};
  image.frame_id = message->header.frame_id;
  image.encoding = message->encoding;
  image.width = message->width;
  image.height = message->height;
  image.step = message->step;
  image.is_bigendian = message->is_bigendian != 0;
  image.data = {message->data.data(), message->data.size()};
  image.owner = message;
  return image;
}

Rigid3 from_ros(const geometry_msgs::msg::Transform& transform) {
  const auto& t = transform.translation;
  const auto& q = transform.rotation;
  return rigid_of({t.x, t.y, t.z}, {q.x, q.y, q.z, q.w});
}

CameraInfo from_ros(const sensor_msgs::msg::CameraInfo& m) {
  CameraInfo info;
  info.width = static_cast<int>(m.width);
  info.height = static_cast<int>(m.height);
  info.distortion_model = m.distortion_model;
  info.D = m.d;
  std::copy(m.k.begin(), m.k.end(), info.K.begin());
  std::copy(m.r.begin(), m.r.end(), info.R.begin());
  std::copy(m.p.begin(), m.p.end(), info.P.begin());
  info.binning_x = static_cast<int>(m.binning_x);
  info.binning_y = static_cast<int>(m.binning_y);
  info.roi = {static_cast<int>(m.roi.x_offset), static_cast<int>(m.roi.y_offset),
              static_cast<int>(m.roi.width), static_cast<int>(m.roi.height)};
  return info;
}

builtin_interfaces::msg::Time to_ros(const Stamp& stamp) {
  builtin_interfaces::msg::Time time;
  time.sec = stamp.sec;
  time.nanosec = stamp.nanosec;
  return time;
}

geometry_msgs::msg::Pose to_ros(const Rigid3& T_a_b) {
  geometry_msgs::msg::Pose pose;
  pose.position.x = T_a_b.t().x();
  pose.position.y = T_a_b.t().y();
  pose.position.z = T_a_b.t().z();
  pose.orientation.x = T_a_b.rotation.x();
  pose.orientation.y = T_a_b.rotation.y();
  pose.orientation.z = T_a_b.rotation.z();
  pose.orientation.w = T_a_b.rotation.w();
  return pose;
}

geometry_msgs::msg::TransformStamped transform_of(const Rigid3& T_a_b, const Stamp& stamp,
                                                  const std::string& a, const std::string& b) {
  const geometry_msgs::msg::Pose pose = to_ros(T_a_b);
  geometry_msgs::msg::TransformStamped transform;
  transform.header.stamp = to_ros(stamp);
  transform.header.frame_id = a;
  transform.child_frame_id = b;
  transform.transform.translation.x = pose.position.x;
  transform.transform.translation.y = pose.position.y;
  transform.transform.translation.z = pose.position.z;
  transform.transform.rotation = pose.orientation;
  return transform;
}

nav_msgs::msg::Odometry odometry_of(const PoseOutput& pose, const NodeOptions& options) {
  nav_msgs::msg::Odometry odometry;
  odometry.header.stamp = to_ros(pose.stamp);
  odometry.header.frame_id = options.odom_frame;
  odometry.child_frame_id = options.base_frame;
  odometry.pose.pose = to_ros(pose.poses.T_odom_base);
  std::copy(pose.poses.covariance.begin(), pose.poses.covariance.end(),
            odometry.pose.covariance.begin());
  if (const auto& twist = pose.poses.twist) {
    odometry.twist.twist.linear.x = twist->linear.x();
    odometry.twist.twist.linear.y = twist->linear.y();
    odometry.twist.twist.linear.z = twist->linear.z();
    odometry.twist.twist.angular.x = twist->angular.x();
    odometry.twist.twist.angular.y = twist->angular.y();
    odometry.twist.twist.angular.z = twist->angular.z();
    std::copy(twist->covariance.begin(), twist->covariance.end(),
              odometry.twist.covariance.begin());
  }
  return odometry;
}

geometry_msgs::msg::PoseStamped pose_of(const PoseOutput& pose, const NodeOptions& options) {
  geometry_msgs::msg::PoseStamped stamped;
  stamped.header.stamp = to_ros(pose.stamp);
  stamped.header.frame_id = options.map_frame;
  stamped.pose = to_ros(pose.poses.T_map_base);
  return stamped;
}

diagnostic_msgs::msg::DiagnosticStatus to_ros(const Diagnostics& diagnostics,
                                              const std::string& name) {
  diagnostic_msgs::msg::DiagnosticStatus status;
  status.level = static_cast<std::uint8_t>(diagnostics.level);
  status.name = name;
  status.message = diagnostics.message;
  for (const auto& [key, value] : diagnostics.values) {
    diagnostic_msgs::msg::KeyValue entry;
    entry.key = key;
    entry.value = value;
    status.values.push_back(entry);
  }
  return status;
}

namespace {

std::int64_t whole(double value) {
  constexpr double kMost = 9e18;
  return static_cast<std::int64_t>(std::clamp(value, -kMost, kMost));
}

template <typename T>
std::string shortest(T value) {
  std::array<char, 64> buffer{};
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return {buffer.data(), end.ptr};
}

}  // namespace

rcl_interfaces::msg::ParameterDescriptor descriptor_of(const Parameter& parameter) {
  rcl_interfaces::msg::ParameterDescriptor descriptor;
  descriptor.description = description_of(parameter);
  descriptor.read_only = true;
  if (parameter.type == Settings::Type::kInteger) {
    rcl_interfaces::msg::IntegerRange range;
    range.from_value = whole(parameter.least);
    range.to_value = whole(parameter.most);
    descriptor.integer_range.push_back(range);
  } else if (parameter.type == Settings::Type::kReal) {
    rcl_interfaces::msg::FloatingPointRange range;
    range.from_value = parameter.least;
    range.to_value = parameter.most;
    descriptor.floating_point_range.push_back(range);
  }
  return descriptor;
}

rclcpp::ParameterValue default_of(const Parameter& parameter) {
  const char* begin = parameter.value.data();
  const char* end = begin + parameter.value.size();
  switch (parameter.type) {
    case Settings::Type::kTruth:
      return rclcpp::ParameterValue(parameter.value == "true");
    case Settings::Type::kInteger: {
      std::int64_t number = 0;
      std::from_chars(begin, end, number);
      return rclcpp::ParameterValue(number);
    }
    case Settings::Type::kReal: {
      double number = 0;
      std::from_chars(begin, end, number);
      return rclcpp::ParameterValue(number);
    }
    case Settings::Type::kText:
    case Settings::Type::kChoice:
      break;
  }
  return rclcpp::ParameterValue(parameter.value);
}

std::string text_of(const rclcpp::ParameterValue& value) {
  switch (value.get_type()) {
    case rclcpp::ParameterType::PARAMETER_BOOL:
      return value.get<bool>() ? "true" : "false";
    case rclcpp::ParameterType::PARAMETER_INTEGER:
      return shortest(value.get<std::int64_t>());
    case rclcpp::ParameterType::PARAMETER_DOUBLE:
      return shortest(value.get<double>());
    default:
      return value.get<std::string>();
  }
}

}  // namespace kys_slam::ros
