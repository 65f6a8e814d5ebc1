// SPDX-License-Identifier: BSD-3-Clause
// The node itself, compiled and run with substitutes for ROS.
#include "stereo_node.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "io/temporary_folder.h"
#include "support/rendered_corridor.h"

namespace kys_slam::ros {
namespace {

using testing::RenderedCorridor;

constexpr std::int32_t kStart = 1700000000;
constexpr int kFrames = 4;

StereoCamera node_camera() {
  return {400, 122, 232, 232, 199.5, 60.5, 0.537};
}

sensor_msgs::msg::Image image_of(const GrayImage& image, int i) {
  sensor_msgs::msg::Image m;
  m.header.stamp = {kStart, 100000001u * static_cast<std::uint32_t>(i)};
  m.header.frame_id = "cam0";
  m.width = static_cast<std::uint32_t>(image.width());
  m.height = static_cast<std::uint32_t>(image.height());
  m.encoding = "bgr8";
  m.step = 3 * m.width;
  for (std::size_t k = 0; k < image.size(); ++k) m.data.insert(m.data.end(), 3, image.data()[k]);
  return m;
}

sensor_msgs::msg::CameraInfo camera_info_of(Side side) {
  const StereoCamera c = node_camera();
  sensor_msgs::msg::CameraInfo m;
  m.width = static_cast<std::uint32_t>(c.width);
  m.height = static_cast<std::uint32_t>(c.height);
  m.distortion_model = "plumb_bob";
  m.d = {0, 0, 0, 0, 0};
  m.k = {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
  m.r = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  m.p = {c.fx, 0, c.cx, side == Side::kRight ? -c.fx * c.baseline : 0, 0, c.fy, c.cy, 0, 0,
         0,    1, 0};
  return m;
}

/// The node with a short drive, 0.3 m forward per frame.
class StereoNodeTest : public ::testing::Test {
 protected:
  void SetUp() override { Bus::get().clear(); }
  void TearDown() override {
    node_.reset();
    Bus::get().clear();
  }

  StereoNode& start() {
    node_ = std::make_unique<StereoNode>(options);
    return *node_;
  }
  void drive(int begin, int end) {
    static const RenderedCorridor corridor(node_camera(), 12);
    for (const Side side : {Side::kLeft, Side::kRight}) {
      Bus::get().give(std::string(to_string(side)) + "/camera_info", camera_info_of(side));
    }
    for (int i = begin; i < end; ++i) {
      const std::size_t before = odometry().size();
      const StereoFrame frame = corridor.look(i, {Eigen::Quaterniond::Identity(), {0, 0, 0.3 * i}});
      Bus::get().give("left/image", image_of(frame.left, i));
      Bus::get().give("right/image", image_of(frame.right, i));
      for (int k = 0; odometry().size() == before && k < 6000; ++k) {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
      ASSERT_GT(odometry().size(), before) << "frame " << i << " has no pose";
    }
  }
  static std::vector<nav_msgs::msg::Odometry> odometry() {
    return Bus::get().all<nav_msgs::msg::Odometry>("odometry");
  }
  static void tick() {
    for (const auto& timer : Bus::get().timers) timer();
  }
  void set(const std::string& name, const rclcpp::ParameterValue& value) {
    options.overrides.insert_or_assign(name, value);
  }

  rclcpp::NodeOptions options;

 private:
  std::unique_ptr<StereoNode> node_;
};

TEST_F(StereoNodeTest, PublishesWhatItTracks) {
  set("camera_frame", rclcpp::ParameterValue(std::string("cam0")));
  set("camera.z", rclcpp::ParameterValue(1.5));
  start();
  drive(0, kFrames);
  const auto poses = odometry();
  ASSERT_EQ(poses.size(), static_cast<std::size_t>(kFrames));
  for (int i = 0; i < kFrames; ++i) {
    const nav_msgs::msg::Odometry& pose = poses[static_cast<std::size_t>(i)];
    EXPECT_EQ(pose.header.stamp.sec, kStart);
    EXPECT_EQ(pose.header.stamp.nanosec, 100000001u * static_cast<std::uint32_t>(i));
    EXPECT_EQ(pose.header.frame_id, "odom");
    EXPECT_EQ(pose.child_frame_id, "base_link");
    EXPECT_NEAR(pose.pose.pose.position.x, 0.3 * i, 0.03);
    EXPECT_NEAR(pose.pose.pose.position.y, 0, 0.03);
    EXPECT_NEAR(pose.pose.pose.position.z, 0, 0.03);
    EXPECT_NEAR(pose.pose.pose.orientation.w, 1, 1e-3);
    if (i == 0) continue;
    EXPECT_NEAR(pose.twist.twist.linear.x, 3, 0.3);
    EXPECT_GT(pose.pose.covariance[0], 0);
    EXPECT_GT(pose.twist.covariance[35], 0);
  }
  const auto tf = Bus::get().all<geometry_msgs::msg::TransformStamped>("/tf");
  ASSERT_EQ(tf.size(), 2u * kFrames);
  EXPECT_EQ(tf[0].header.frame_id, "map");
  EXPECT_EQ(tf[0].child_frame_id, "odom");
  EXPECT_EQ(tf[7].child_frame_id, "base_link");
  EXPECT_NEAR(tf[7].transform.translation.x, 0.9, 0.03);
  const auto fixed = Bus::get().all<geometry_msgs::msg::TransformStamped>("/tf_static");
  ASSERT_EQ(fixed.size(), 1u);
  EXPECT_EQ(fixed[0].child_frame_id, "cam0");
  EXPECT_EQ(fixed[0].transform.translation.z, 1.5);
  EXPECT_NEAR(std::abs(fixed[0].transform.rotation.x), 0.5, 1e-12);
  EXPECT_EQ(Bus::get().all<geometry_msgs::msg::PoseStamped>("pose").back().header.frame_id, "map");
}

/// The camera is 1 m to the left of base_link and looks back; the robot drives backwards.
TEST_F(StereoNodeTest, LooksUpWhereTheCameraIs) {
  set("camera_pose", rclcpp::ParameterValue(std::string("tf")));
  geometry_msgs::msg::TransformStamped mounted;
  mounted.header.frame_id = "base_link";
  mounted.child_frame_id = "cam0";
  mounted.transform.translation.y = 1;
  mounted.transform.rotation = {0.5, 0.5, -0.5, -0.5};  // x right is y left, z forward is x back
  Bus::get().transforms = {mounted};
  start();
  drive(0, 3);
  const auto poses = odometry();
  ASSERT_EQ(poses.size(), 3u);
  EXPECT_NEAR(poses[2].pose.pose.position.x, -0.6, 0.03);
  EXPECT_NEAR(poses[2].pose.pose.position.y, 0, 0.03);
  EXPECT_NEAR(poses[2].twist.twist.linear.x, -3, 0.3);
  EXPECT_TRUE(Bus::get().all<geometry_msgs::msg::TransformStamped>("/tf_static").empty());
}

TEST_F(StereoNodeTest, SaysWhichTransformIsMissing) {
  set("camera_pose", rclcpp::ParameterValue(std::string("tf")));
  StereoNode& node = start();
  for (const Side side : {Side::kLeft, Side::kRight}) {
    Bus::get().give(std::string(to_string(side)) + "/camera_info", camera_info_of(side));
    Bus::get().give(std::string(to_string(side)) + "/image", image_of(GrayImage(400, 122), 0));
  }
  const std::string expected =
      "ERROR the transform from base_link to cam0: \"base_link\" passed to "
      "lookupTransform does not exist.";
  const auto is_logged = [&] {
    const std::lock_guard lock(Bus::get().mutex);
    return std::ranges::count(Bus::get().log, expected) == 1;
  };
  for (int k = 0; !is_logged() && k < 6000; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(is_logged());
  EXPECT_TRUE(node.finish());
  EXPECT_TRUE(odometry().empty());
}

TEST_F(StereoNodeTest, ReportsOnceASecond) {
  start();
  tick();
  drive(0, 2);
  tick();
  const auto states = Bus::get().all<diagnostic_msgs::msg::DiagnosticArray>("/diagnostics");
  ASSERT_EQ(states.size(), 2u);
  EXPECT_EQ(states[0].status[0].name, "kys_slam: tracking");
  EXPECT_EQ(states[0].status[0].level, 1);
  EXPECT_EQ(states[0].status[0].message, "no camera_info of left and right");
  EXPECT_EQ(states[1].status[0].values[0].key, "status");
  EXPECT_EQ(states[1].status[0].values[0].value, "tracked");
  const auto paths = Bus::get().all<nav_msgs::msg::Path>("path");
  ASSERT_EQ(paths.size(), 1u);
  EXPECT_EQ(paths[0].poses.size(), 2u);
  EXPECT_EQ(paths[0].header.frame_id, "map");
}

TEST_F(StereoNodeTest, Services) {
  using kys_slam_ros::srv::LoadMap;
  using kys_slam_ros::srv::SaveMap;
  using std_srvs::srv::Trigger;
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "a.map").string();
  start();
  EXPECT_FALSE(Bus::get().call<SaveMap>("~/save_map", {{file}}).success);
  drive(0, 3);
  const auto saved = Bus::get().call<SaveMap>("~/save_map", {{file}});
  EXPECT_TRUE(saved.success) << saved.message;
  EXPECT_TRUE(std::filesystem::exists(file));
  const auto missing = Bus::get().call<LoadMap>("~/load_map", {{file + "x", false}});
  EXPECT_FALSE(missing.success);
  EXPECT_NE(missing.message.find("a.mapx"), std::string::npos);
  EXPECT_TRUE(Bus::get().call<LoadMap>("~/load_map", {{file, true}}).success);
  EXPECT_TRUE(Bus::get().call<Trigger>("~/reset", {}).success);
  EXPECT_EQ(std::ranges::count_if(
                Bus::get().log,
                [](const std::string& line) { return line == "WARN reset: the run starts again"; }),
            1);
}

TEST_F(StereoNodeTest, DeclaresEveryParameterWithItsRange) {
  set("orb.features", rclcpp::ParameterValue(std::int64_t{700}));
  set("image_transport", rclcpp::ParameterValue(std::string("compressed")));
  start();
  const auto& parameters = Bus::get().parameters;
  EXPECT_EQ(parameters.size(), node_parameters().size() + setting_parameters(false).size());
  const auto& features = parameters.at("orb.features");
  ASSERT_EQ(features.integer_range.size(), 1u);
  EXPECT_LE(features.integer_range[0].from_value, 700);
  EXPECT_GE(features.integer_range[0].to_value, 700);
  EXPECT_TRUE(features.read_only);
  ASSERT_EQ(parameters.at("tolerance").floating_point_range.size(), 1u);
  EXPECT_EQ(parameters.at("tolerance").floating_point_range[0].to_value, 1);
  for (const auto& [name, descriptor] : parameters)
    EXPECT_FALSE(descriptor.description.empty()) << name;
  EXPECT_EQ(Bus::get().transports.at("left/image"), "compressed");
  EXPECT_FALSE(Bus::get().handlers.contains("segments"));
}

TEST_F(StereoNodeTest, LabelImagesAndMasksReachTheLogic) {
  set("segments", rclcpp::ParameterValue(true));
  set("control.segment_every", rclcpp::ParameterValue(std::int64_t{0}));  // the map waits for none
  start();
  drive(0, 1);
  sensor_msgs::msg::Image labels;
  labels.header.stamp = {kStart, 0};
  labels.encoding = "8UC3";
  Bus::get().give("segments", labels);
  sensor_msgs::msg::Image mask;
  mask.encoding = "32FC1";
  Bus::get().give("left/mask", mask);
  const auto has = [](const char* part) {
    return std::ranges::any_of(Bus::get().log, [&](const std::string& line) {
      return line.find(part) != std::string::npos;
    });
  };
  EXPECT_TRUE(has("ERROR segments with encoding '8UC3'"));
  EXPECT_TRUE(has("ERROR a mask with encoding '32FC1'"));
}

TEST_F(StereoNodeTest, WritesItsFolderAtTheEnd) {
  const TemporaryFolder folder;
  set("output", rclcpp::ParameterValue((folder.path() / "run").string()));
  StereoNode& node = start();
  drive(0, 2);
  EXPECT_TRUE(node.finish());
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "run" / "summary.json"));
  EXPECT_TRUE(node.finish());  // once
}

TEST_F(StereoNodeTest, AParameterThatCannotBe) {
  set("odom_frame", rclcpp::ParameterValue(std::string("map")));
  EXPECT_THROW(start(), InputError);
}

}  // namespace
}  // namespace kys_slam::ros
