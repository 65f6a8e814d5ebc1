// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <geometry_msgs/msg/pose_stamped.hpp>
#include <image_transport/image_transport.hpp>
#include <kys_slam_ros/srv/load_map.hpp>
#include <kys_slam_ros/srv/save_map.hpp>
#include <memory>
#include <nav_msgs/msg/odometry.hpp>
#include <nav_msgs/msg/path.hpp>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/image.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <string>
#include <thread>
#include <vector>

#include "node_logic.h"

namespace kys_slam::ros {

/// The ROS 2 node: converts messages to and from NodeLogic, which does the rest. ../README.md lists
/// topics, services and parameters.
class StereoNode : public rclcpp::Node, private NodeOutput {
 public:
  explicit StereoNode(const rclcpp::NodeOptions& options);
  /// Ends the run and writes its folder.
  ~StereoNode() override;
  StereoNode(const StereoNode&) = delete;
  StereoNode& operator=(const StereoNode&) = delete;

  /// False: the folder of the results could not be written.
  bool finish();

 private:
  void publish(const PoseOutput& pose) override;
  void log(Level level, const std::string& text) override;

  [[nodiscard]] GivenValue declare();
  [[nodiscard]] Rigid3 look_up(const std::string& a, const std::string& b) const;
  void publish_camera_frame();
  void advertise();
  void subscribe();
  void subscribe_side(Side side);
  void serve();
  void report();

  NodeOptions options_;
  // For camera_pose tf alone.
  std::unique_ptr<tf2_ros::Buffer> tf_buffer_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  std::unique_ptr<NodeLogic> logic_;
  std::thread thread_;  // that tracks

  tf2_ros::TransformBroadcaster tf_;
  tf2_ros::StaticTransformBroadcaster static_tf_;
  rclcpp::Publisher<nav_msgs::msg::Odometry>::SharedPtr odometry_;
  rclcpp::Publisher<geometry_msgs::msg::PoseStamped>::SharedPtr pose_;
  rclcpp::Publisher<nav_msgs::msg::Path>::SharedPtr path_;
  rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>::SharedPtr diagnostics_;
  std::vector<image_transport::Subscriber> images_;
  std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions_;
  rclcpp::Service<std_srvs::srv::Trigger>::SharedPtr reset_;
  rclcpp::Service<kys_slam_ros::srv::SaveMap>::SharedPtr save_map_;
  rclcpp::Service<kys_slam_ros::srv::LoadMap>::SharedPtr load_map_;
  rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace kys_slam::ros
