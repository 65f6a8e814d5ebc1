// SPDX-License-Identifier: BSD-3-Clause
// Untested: see ../README.md.
#include <kys_slam/error.h>
#include <kys_slam/image_view.h>
#include <kys_slam/ros_covariance.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/stereo_rig.h>
#include <kys_slam/system.h>
#include <message_filters/subscriber.h>
#include <message_filters/sync_policies/approximate_time.h>
#include <message_filters/synchronizer.h>
#include <tf2_ros/transform_broadcaster.h>

#include <algorithm>
#include <geometry_msgs/msg/transform_stamped.hpp>
#include <memory>
#include <nav_msgs/msg/odometry.hpp>
#include <nav_msgs/msg/path.hpp>
#include <optional>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/image.hpp>
#include <string>
#include <vector>

using sensor_msgs::msg::CameraInfo;
using sensor_msgs::msg::Image;

namespace {

kys_slam::CameraInfo convert(const CameraInfo& m) {
  kys_slam::CameraInfo info;
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

/// The pixels of a message, which must outlive the view.
kys_slam::ImageView view_of(const Image& m) {
  using kys_slam::PixelFormat;
  PixelFormat format = PixelFormat::kGray8;
  int channels = 1, bytes = 1;
  if (m.encoding == "mono16" || m.encoding == "16UC1") {
    bytes = 2;
  } else if (m.encoding == "bgr8" || m.encoding == "rgb8") {
    format = m.encoding == "bgr8" ? PixelFormat::kBgr8 : PixelFormat::kRgb8, channels = 3;
  } else if (m.encoding != "mono8" && m.encoding != "8UC1") {
    throw kys_slam::InputError("image encoding '" + m.encoding + "' is not supported");
  }
  if (m.step < m.width * channels * bytes || m.data.size() < std::size_t{m.step} * m.height) {
    throw kys_slam::InputError("an image message with too few bytes");
  }
  kys_slam::ImageView view{m.data.data(), static_cast<int>(m.width), static_cast<int>(m.height),
                           format, static_cast<std::ptrdiff_t>(m.step)};
  if (bytes == 2) {
    view.pixel_step = 2;  // big endian: the high byte alone
    if (!m.is_bigendian) view.format = PixelFormat::kGray16;
  }
  return view;
}

class StereoNode : public rclcpp::Node {
 public:
  StereoNode() : Node("kys_slam"), tf_(*this) {
    declare_parameter("driving", false);
    declare_parameter("settings", std::vector<std::string>());
    declare_parameter("output", std::string());
    const double tolerance = declare_parameter("tolerance", 0.01);
    odometry_ = create_publisher<nav_msgs::msg::Odometry>("odometry", 10);
    path_ = create_publisher<nav_msgs::msg::Path>("path", 1);
    for (int side = 0; side < 2; ++side) {
      const std::string name = side == 0 ? "left" : "right";
      info_subscribers_[side] = create_subscription<CameraInfo>(name + "/camera_info", 1,
                                                                [this, side](const CameraInfo& m) {
                                                                  if (m.k[0] != 0 || m.p[0] != 0)
                                                                    infos_[side] = convert(m);
                                                                });
      images_[side].subscribe(this, name + "/image", rmw_qos_profile_sensor_data);
    }
    pairs_ =
        std::make_unique<message_filters::Synchronizer<Policy>>(Policy(20), images_[0], images_[1]);
    pairs_->setMaxIntervalDuration(rclcpp::Duration::from_seconds(tolerance));
    pairs_->registerCallback(&StereoNode::track, this);
  }

  /// Ends the run and writes its folder.
  void finish() {
    if (!slam_) return;
    slam_->finish();
    const std::string output = get_parameter("output").as_string();
    if (output.empty()) return;
    kys_slam::RunInfo info;
    info.sequence = "ros";
    info.mode = settings_.get("kys.mode");
    kys_slam::write_run(output, *slam_, settings_, kys_slam::Schedule::kRealtime, info,
                        kys_slam::summarise_run(*slam_, info));
  }

 private:
  using Policy = message_filters::sync_policies::ApproximateTime<Image, Image>;

  void start(const kys_slam::ImageView& left, const kys_slam::ImageView& right) {
    kys_slam::StereoRig rig =
        kys_slam::rig_from_camera_info(*infos_[0], *infos_[1], "ros", left.width, left.height);
    rig.set_image_size(left.width, left.height);
    bits_ = std::max(kys_slam::used_bits(left), kys_slam::used_bits(right));
    if (const std::string note = kys_slam::note_of_bits(bits_); !note.empty()) {
      RCLCPP_WARN(get_logger(), "%s", note.c_str());
    }
    kys_slam::StereoCamera camera;
    if (const auto rectified = rig.rectified()) {
      camera = *rectified;
    } else {
      rectifier_.emplace(rig.left, rig.right, rig.name);
      camera = rectifier_->camera();
    }
    if (!get_parameter("driving").as_bool()) settings_ = kys_slam::Settings::indoor();
    for (const std::string& s : get_parameter("settings").as_string_array()) settings_.assign(s);
    slam_ = std::make_unique<kys_slam::System>(camera, settings_, kys_slam::Schedule::kRealtime);
  }

  void track(const Image::ConstSharedPtr& left, const Image::ConstSharedPtr& right) {
    if (!infos_[0] || !infos_[1]) {
      RCLCPP_INFO_THROTTLE(get_logger(), *get_clock(), 2000, "waiting for camera_info");
      return;
    }
    try {
      kys_slam::ImageView views[2] = {view_of(*left), view_of(*right)};
      if (!slam_) start(views[0], views[1]);
      for (kys_slam::ImageView& view : views) view.bits = bits_;
      kys_slam::StereoFrame frame;
      frame.index = frames_++;
      frame.timestamp = rclcpp::Time(left->header.stamp).seconds();
      frame.left = kys_slam::to_gray(views[0]);
      frame.right = kys_slam::to_gray(views[1]);
      if (rectifier_) {
        frame.left = rectifier_->rectify_left(frame.left);
        frame.right = rectifier_->rectify_right(frame.right);
      }
      const kys_slam::FrameReport report = slam_->feed(frame);
      if (report.warning != warning_ && !report.warning.empty()) {
        RCLCPP_WARN(get_logger(), "%s", report.warning.c_str());
      }
      warning_ = report.warning;
      if (report.status == kys_slam::FrameStatus::kLost) {
        RCLCPP_WARN(get_logger(), "lost: %s", report.reason.c_str());
        return;
      }
      publish(report, left->header.stamp);
    } catch (const kys_slam::InputError& error) {
      RCLCPP_ERROR(get_logger(), "%s", error.what());
    }
  }

  /// Covariance and twist of a frame that starts a map or is relocalised stay zero: not known.
  void add_covariances(const kys_slam::FrameReport& report, nav_msgs::msg::Odometry& odometry) {
    if (report.local) {
      const auto covariance = kys_slam::ros_pose_covariance(report.local->covariance, report.T_w_c);
      std::copy(covariance.begin(), covariance.end(), odometry.pose.covariance.begin());
    }
    if (!report.motion) return;
    if (const auto twist = kys_slam::ros_twist(*report.motion, report.timestamp - tracked_)) {
      odometry.twist.twist.linear.x = twist->linear.x();
      odometry.twist.twist.linear.y = twist->linear.y();
      odometry.twist.twist.linear.z = twist->linear.z();
      odometry.twist.twist.angular.x = twist->angular.x();
      odometry.twist.twist.angular.y = twist->angular.y();
      odometry.twist.twist.angular.z = twist->angular.z();
      std::copy(twist->covariance.begin(), twist->covariance.end(),
                odometry.twist.covariance.begin());
    }
  }

  void publish(const kys_slam::FrameReport& report, const builtin_interfaces::msg::Time& stamp) {
    const kys_slam::Rigid3& T_w_c = report.T_w_c;
    nav_msgs::msg::Odometry odometry;
    odometry.header.stamp = stamp;
    odometry.header.frame_id = "map";
    odometry.child_frame_id = "camera";
    auto& pose = odometry.pose.pose;
    pose.position.x = T_w_c.t().x();
    pose.position.y = T_w_c.t().y();
    pose.position.z = T_w_c.t().z();
    pose.orientation.x = T_w_c.rotation.x();
    pose.orientation.y = T_w_c.rotation.y();
    pose.orientation.z = T_w_c.rotation.z();
    pose.orientation.w = T_w_c.rotation.w();
    add_covariances(report, odometry);
    tracked_ = report.timestamp;
    odometry_->publish(odometry);

    geometry_msgs::msg::TransformStamped transform;
    transform.header = odometry.header;
    transform.child_frame_id = "camera";
    transform.transform.translation.x = pose.position.x;
    transform.transform.translation.y = pose.position.y;
    transform.transform.translation.z = pose.position.z;
    transform.transform.rotation = pose.orientation;
    tf_.sendTransform(transform);

    geometry_msgs::msg::PoseStamped stamped;
    stamped.header = odometry.header;
    stamped.pose = pose;
    walked_.header = odometry.header;
    walked_.poses.push_back(stamped);
    path_->publish(walked_);
  }

  tf2_ros::TransformBroadcaster tf_;
  rclcpp::Publisher<nav_msgs::msg::Odometry>::SharedPtr odometry_;
  rclcpp::Publisher<nav_msgs::msg::Path>::SharedPtr path_;
  nav_msgs::msg::Path walked_;
  rclcpp::Subscription<CameraInfo>::SharedPtr info_subscribers_[2];
  message_filters::Subscriber<Image> images_[2];
  std::unique_ptr<message_filters::Synchronizer<Policy>> pairs_;
  std::optional<kys_slam::CameraInfo> infos_[2];
  std::optional<kys_slam::StereoRectifier> rectifier_;
  kys_slam::Settings settings_;
  std::unique_ptr<kys_slam::System> slam_;
  std::int64_t frames_ = 0;
  int bits_ = 0;         // of 16-bit images, 0: not known
  double tracked_ = 0;   // s, time stamp of the last frame with a pose
  std::string warning_;  // of the last frame
};

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  const auto node = std::make_shared<StereoNode>();
  rclcpp::spin(node);
  int status = 0;
  try {
    node->finish();
  } catch (const kys_slam::InputError& error) {  // the folder cannot be written
    RCLCPP_ERROR(node->get_logger(), "%s", error.what());
    status = 2;
  }
  rclcpp::shutdown();
  return status;
}
