// SPDX-License-Identifier: BSD-3-Clause
#include "stereo_node.h"

#include <kys_slam/error.h>
#include <tf2/exceptions.h>
#include <tf2/time.h>

#include <chrono>
#include <map>
#include <rclcpp_components/register_node_macro.hpp>
#include <utility>

#include "conversions.h"

namespace kys_slam::ros {

namespace {

using sensor_msgs::msg::Image;

constexpr auto kReportPeriod = std::chrono::seconds(1);

}  // namespace

StereoNode::StereoNode(const rclcpp::NodeOptions& options)
    : Node("kys_slam", options), tf_(*this), static_tf_(*this) {
  const GivenValue given = declare();
  options_ = read_options(given);
  if (options_.camera_pose == CameraPose::kTf) {
    tf_buffer_ = std::make_unique<tf2_ros::Buffer>(get_clock());
    tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_buffer_);
  }
  NodeOutput& output = *this;
  logic_ = std::make_unique<NodeLogic>(
      options_, read_settings(options_, given), output,
      [this](const std::string& a, const std::string& b) { return look_up(a, b); });
  advertise();
  publish_camera_frame();
  subscribe();
  serve();
  timer_ = create_wall_timer(kReportPeriod, [this] { report(); });
  thread_ = std::thread([this] { logic_->run(); });
}

StereoNode::~StereoNode() {
  finish();
}

bool StereoNode::finish() {
  if (!thread_.joinable()) return true;
  logic_->stop();
  thread_.join();
  try {
    logic_->finish();
  } catch (const std::exception& error) {
    RCLCPP_ERROR(get_logger(), "%s", error.what());
    return false;
  }
  return true;
}

/// Declares all parameters; the function returned gives the values of those that the user gave.
GivenValue StereoNode::declare() {
  std::map<std::string, std::string> values;
  bool driving = false;
  const auto& given = get_node_parameters_interface()->get_parameter_overrides();
  const auto declare_all = [&](const std::vector<Parameter>& parameters) {
    for (const Parameter& p : parameters) {
      const std::string text = text_of(declare_parameter(p.key, default_of(p), descriptor_of(p)));
      if (given.find(p.key) != given.end()) values[p.key] = text;
      if (p.key == "driving") driving = text == "true";
    }
  };
  declare_all(node_parameters());
  declare_all(setting_parameters(driving));
  return [values](const Parameter& p) -> std::optional<std::string> {
    const auto value = values.find(p.key);
    if (value == values.end()) return std::nullopt;
    return value->second;
  };
}

void StereoNode::advertise() {
  odometry_ = create_publisher<nav_msgs::msg::Odometry>("odometry", 10);
  pose_ = create_publisher<geometry_msgs::msg::PoseStamped>("pose", 10);
  path_ = create_publisher<nav_msgs::msg::Path>("path", 1);
  diagnostics_ = create_publisher<diagnostic_msgs::msg::DiagnosticArray>("/diagnostics", 10);
}

Rigid3 StereoNode::look_up(const std::string& a, const std::string& b) const {
  const std::string name = "the transform from " + a + " to " + b + ": ";
  try {
    return from_ros(tf_buffer_->lookupTransform(a, b, tf2::TimePointZero).transform);
  } catch (const tf2::TransformException& error) {
    throw InputError(name + error.what());
  } catch (const InputError& error) {
    throw InputError(name + error.what());
  }
}

void StereoNode::publish_camera_frame() {
  if (options_.camera_pose == CameraPose::kTf || options_.camera_frame.empty()) return;
  static_tf_.sendTransform(
      transform_of(options_.T_base_camera(), {}, options_.base_frame, options_.camera_frame));
}

void StereoNode::subscribe() {
  subscribe_side(Side::kLeft);
  subscribe_side(Side::kRight);
  if (!options_.segments) return;
  subscriptions_.push_back(create_subscription<Image>(
      "segments", rclcpp::SensorDataQoS(),
      [this](const Image::ConstSharedPtr& m) { logic_->add_segments(from_ros(m)); }));
}

void StereoNode::subscribe_side(Side side) {
  const std::string name = to_string(side);
  const bool reliable = options_.reliability == Reliability::kReliable;
  images_.push_back(image_transport::create_subscription(
      this, name + "/image",
      [this, side](const Image::ConstSharedPtr& m) { logic_->add_image(side, from_ros(m)); },
      options_.image_transport, reliable ? rmw_qos_profile_default : rmw_qos_profile_sensor_data));
  subscriptions_.push_back(create_subscription<sensor_msgs::msg::CameraInfo>(
      name + "/camera_info", rclcpp::SensorDataQoS(),
      [this, side](const sensor_msgs::msg::CameraInfo::ConstSharedPtr& m) {
        logic_->add_camera_info(side, from_ros(*m));
      }));
  // Published once, also before this node starts.
  subscriptions_.push_back(create_subscription<Image>(
      name + "/mask", rclcpp::QoS(1).reliable().transient_local(),
      [this, side](const Image::ConstSharedPtr& m) { logic_->set_mask(side, from_ros(m)); }));
}

void StereoNode::serve() {
  using kys_slam_ros::srv::LoadMap;
  using kys_slam_ros::srv::SaveMap;
  using std_srvs::srv::Trigger;
  const auto answer = [](auto& response, const NodeLogic::Answer& from) {
    response.success = from.success;
    response.message = from.message;
  };
  reset_ = create_service<Trigger>("~/reset",
                                   [this, answer](const Trigger::Request::SharedPtr&,
                                                  const Trigger::Response::SharedPtr& response) {
                                     answer(*response, logic_->reset());
                                   });
  save_map_ = create_service<SaveMap>("~/save_map",
                                      [this, answer](const SaveMap::Request::SharedPtr& request,
                                                     const SaveMap::Response::SharedPtr& response) {
                                        answer(*response, logic_->save_map(request->file));
                                      });
  load_map_ = create_service<LoadMap>(
      "~/load_map", [this, answer](const LoadMap::Request::SharedPtr& request,
                                   const LoadMap::Response::SharedPtr& response) {
        answer(*response, logic_->load_map(request->file, request->localize_only));
      });
}

void StereoNode::publish(const PoseOutput& pose) {
  odometry_->publish(odometry_of(pose, options_));
  pose_->publish(pose_of(pose, options_));
  if (!options_.publish_tf) return;
  tf_.sendTransform(std::vector{
      transform_of(pose.poses.T_map_odom, pose.stamp, options_.map_frame, options_.odom_frame),
      transform_of(pose.poses.T_odom_base, pose.stamp, options_.odom_frame, options_.base_frame)});
}

void StereoNode::log(Level level, const std::string& text) {
  switch (level) {
    case Level::kInfo:
      RCLCPP_INFO(get_logger(), "%s", text.c_str());
      break;
    case Level::kWarn:
      RCLCPP_WARN(get_logger(), "%s", text.c_str());
      break;
    case Level::kError:
      RCLCPP_ERROR(get_logger(), "%s", text.c_str());
      break;
  }
}

/// Diagnostics, and the path for those who look on.
void StereoNode::report() {
  diagnostic_msgs::msg::DiagnosticArray array;
  array.header.stamp = now();
  array.status.push_back(to_ros(logic_->diagnostics(), std::string(get_name()) + ": tracking"));
  diagnostics_->publish(array);
  if (path_->get_subscription_count() == 0) return;
  nav_msgs::msg::Path path;
  path.header.frame_id = options_.map_frame;
  for (const PoseOutput& pose : logic_->path()) path.poses.push_back(pose_of(pose, options_));
  if (path.poses.empty()) return;
  path.header.stamp = path.poses.back().header.stamp;
  path_->publish(path);
}

}  // namespace kys_slam::ros

RCLCPP_COMPONENTS_REGISTER_NODE(kys_slam::ros::StereoNode)
