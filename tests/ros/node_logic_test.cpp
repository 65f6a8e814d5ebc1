// SPDX-License-Identifier: BSD-3-Clause
// The node on a rendered corridor, with its messages as ROS brings them.
#include "node_logic.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <numbers>
#include <thread>

#include "io/temporary_folder.h"
#include "support/rendered_corridor.h"

namespace kys_slam::ros {
namespace {

using testing::RenderedCorridor;

StereoCamera corridor_camera() {
  return {400, 122, 232, 232, 199.5, 60.5, 0.537};
}

/// 0.3 m forward per frame.
Rigid3 corridor_pose(int i) {
  return {Eigen::Quaterniond::Identity(), {0, 0, 0.3 * i}};
}

constexpr int kImages = 6;

const std::vector<StereoFrame>& images() {
  static const std::vector<StereoFrame> frames = [] {
    const RenderedCorridor corridor(corridor_camera(), 12);
    std::vector<StereoFrame> all;
    for (int i = 0; i < kImages; ++i) all.push_back(corridor.look(i, corridor_pose(i)));
    return all;
  }();
  return frames;
}

CameraInfo info_of(Side side) {
  const StereoCamera c = corridor_camera();
  CameraInfo info;
  info.width = c.width;
  info.height = c.height;
  info.distortion_model = "plumb_bob";
  info.D = {0, 0, 0, 0, 0};
  info.K = {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double shift = side == Side::kRight ? -c.fx * c.baseline : 0;
  info.P = {c.fx, 0, c.cx, shift, 0, c.fy, c.cy, 0, 0, 0, 1, 0};
  return info;
}

ImageMessage message_of(const GrayImage& image, const Stamp& stamp) {
  const auto owner = std::make_shared<const GrayImage>(image);
  ImageMessage m;
  m.stamp = stamp;
  m.frame_id = "cam0_optical";
  m.encoding = "mono8";
  m.width = static_cast<std::uint32_t>(image.width());
  m.height = static_cast<std::uint32_t>(image.height());
  m.step = m.width;
  m.data = {owner->data(), owner->size()};
  m.owner = owner;
  return m;
}

struct Recorder : NodeOutput {
  void publish(const PoseOutput& pose) override { poses.push_back(pose); }
  void log(Level level, const std::string& text) override { lines.emplace_back(level, text); }
  [[nodiscard]] int count(const std::string& part) const {
    return static_cast<int>(std::ranges::count_if(
        lines, [&](const auto& line) { return line.second.find(part) != std::string::npos; }));
  }
  std::vector<PoseOutput> poses;
  std::vector<std::pair<Level, std::string>> lines;
};

std::string value_of(const Diagnostics& state, const std::string& name) {
  for (const auto& [key, value] : state.values) {
    if (key == name) return value;
  }
  return "no " + name;
}

class NodeLogicTest : public ::testing::Test {
 protected:
  explicit NodeLogicTest() { options.schedule = Schedule::kSequential; }

  NodeLogic& node() {
    if (!logic_) logic_ = std::make_unique<NodeLogic>(options, settings, output, look_up);
    return *logic_;
  }
  void give_infos() {
    for (const Side side : {Side::kLeft, Side::kRight}) node().add_camera_info(side, info_of(side));
  }
  static Stamp stamp(int i, std::int32_t start = 1700000000) {
    return {start, 100000007u * static_cast<std::uint32_t>(i)};
  }
  void give(int i, const Stamp& at) {
    const StereoFrame& frame = images()[static_cast<std::size_t>(i)];
    node().add_image(Side::kLeft, message_of(frame.left, at));
    node().add_image(Side::kRight, message_of(frame.right, at));
  }
  void track(int begin, int end, std::int32_t start = 1700000000) {
    for (int i = begin; i < end; ++i) {
      give(i, stamp(i, start));
      while (node().track_next()) {
      }
    }
  }

  NodeOptions options;
  Settings settings = Settings::indoor();
  Recorder output;
  TransformLookup look_up;

 private:
  std::unique_ptr<NodeLogic> logic_;
};

TEST_F(NodeLogicTest, PosesInRosFramesWithTheStampsOfTheImages) {
  options.camera_x = 0.5;
  give_infos();
  track(0, kImages);
  ASSERT_EQ(output.poses.size(), static_cast<std::size_t>(kImages));
  for (int i = 0; i < kImages; ++i) {
    const PoseOutput& pose = output.poses[static_cast<std::size_t>(i)];
    EXPECT_EQ(pose.stamp, stamp(i));
    const Eigen::Vector3d expected(0.3 * i, 0, 0);  // forward is x
    EXPECT_LT((pose.poses.T_map_base.t() - expected).norm(), 0.03) << i;
    EXPECT_LT((pose.poses.T_odom_base.t() - expected).norm(), 0.03) << i;
    EXPECT_LT(rotation_angle(pose.poses.T_map_base), 0.01) << i;
    if (i == 0) continue;
    ASSERT_TRUE(pose.poses.twist) << i;
    EXPECT_NEAR(pose.poses.twist->linear.x(), 3, 0.3);  // 0.3 m in 0.1 s
    for (std::size_t k = 0; k < 6; ++k) EXPECT_GT(pose.poses.covariance[7 * k], 0) << k;
  }
  EXPECT_EQ(node().path().size(), static_cast<std::size_t>(kImages));
  const Diagnostics state = node().diagnostics();
  EXPECT_EQ(value_of(state, "status"), "tracked");
  EXPECT_EQ(value_of(state, "frame rate (1/s, by stamps)"), "10.0");
  EXPECT_EQ(value_of(state, "frames"), "6");
  EXPECT_EQ(value_of(state, "lost frames"), "0");
  EXPECT_EQ(node().diagnostics().level, Diagnostics::Level::kStale);  // nothing came since
}

/// The camera looks to the left of the robot, which drives sideways: base_link moves along its y.
/// The transform comes after two pairs.
TEST_F(NodeLogicTest, ThePoseOfTheCameraFromTf) {
  options.camera_pose = CameraPose::kTf;
  int calls = 0;
  look_up = [&](const std::string& a, const std::string& b) -> Rigid3 {
    EXPECT_EQ(a, "base_link");
    EXPECT_EQ(b, "cam0_optical");
    if (++calls <= 2) throw InputError("base_link is not known");
    return base_from_camera({0.2, 0.1, 0.5}, {0, 0, 0.5 * std::numbers::pi});
  };
  give_infos();
  track(0, 2);
  EXPECT_TRUE(output.poses.empty());
  EXPECT_EQ(output.count("base_link is not known"), 1);
  EXPECT_EQ(node().diagnostics().message, "base_link is not known");
  track(2, kImages);
  ASSERT_EQ(output.poses.size(), static_cast<std::size_t>(kImages - 2));
  EXPECT_EQ(calls, 3);
  for (int i = 2; i < kImages; ++i) {
    const PoseOutput& pose = output.poses[static_cast<std::size_t>(i - 2)];
    const Eigen::Vector3d expected(0, 0.3 * (i - 2), 0);
    EXPECT_LT((pose.poses.T_odom_base.t() - expected).norm(), 0.03) << i;
    if (i == 2) continue;
    EXPECT_NEAR(pose.poses.twist.value().linear.y(), 3, 0.3);
  }
  EXPECT_TRUE(node().reset().success);
  track(0, 1, 1800000000);
  EXPECT_EQ(calls, 4);  // each run looks it up
  EXPECT_LT(output.poses.back().poses.T_map_base.t().norm(), 1e-9);
}

TEST_F(NodeLogicTest, TheFrameOfTheCameraByParameter) {
  options.camera_pose = CameraPose::kTf;
  options.base_frame = "robot";
  options.camera_frame = "left_eye";
  std::vector<std::string> asked;
  look_up = [&](const std::string& a, const std::string& b) {
    asked = {a, b};
    return optical_to_body();
  };
  give_infos();
  track(0, 2);
  EXPECT_EQ(asked, (std::vector<std::string>{"robot", "left_eye"}));
  EXPECT_NEAR(output.poses.at(1).poses.T_odom_base.t().x(), 0.3, 0.03);
}

TEST_F(NodeLogicTest, ImagesWithoutAFrameHaveNoPlaceInTf) {
  options.camera_pose = CameraPose::kTf;
  look_up = [](const std::string&, const std::string&) { return Rigid3(); };
  give_infos();
  for (const Side side : {Side::kLeft, Side::kRight}) {
    ImageMessage message = message_of(images()[0].left, stamp(0));
    message.frame_id.clear();
    node().add_image(side, message);
  }
  while (node().track_next()) {
  }
  EXPECT_EQ(output.count("no frame_id"), 1);
  EXPECT_TRUE(output.poses.empty());
}

TEST_F(NodeLogicTest, TfIsAskedForWhereThereIsNone) {
  options.camera_pose = CameraPose::kTf;
  EXPECT_THROW(node(), InputError);
}

TEST_F(NodeLogicTest, WaitsForACalibrationThatIsOne) {
  EXPECT_EQ(node().diagnostics().message, "no camera_info of left and right");
  track(0, 1);
  EXPECT_TRUE(output.poses.empty());
  CameraInfo zeros = info_of(Side::kLeft);
  zeros.K = {}, zeros.P = {};
  node().add_camera_info(Side::kLeft, zeros);
  EXPECT_EQ(node().diagnostics().message, "no camera_info of left and right");
  node().add_camera_info(Side::kRight, info_of(Side::kRight));
  EXPECT_EQ(node().diagnostics().message, "no camera_info of left");
  node().add_camera_info(Side::kLeft, info_of(Side::kLeft));
  track(1, 2);
  EXPECT_EQ(output.poses.size(), 1u);
}

TEST_F(NodeLogicTest, AnotherCalibrationIsRefusedUntilAReset) {
  give_infos();
  track(0, 2);
  CameraInfo other = info_of(Side::kRight);
  other.P[3] *= 2;
  node().add_camera_info(Side::kRight, other);
  node().add_camera_info(Side::kRight, other);
  EXPECT_EQ(output.count("has changed, which is refused"), 1);
  track(2, 4);
  EXPECT_EQ(output.poses.size(), 4u);
  EXPECT_NEAR(output.poses.back().poses.T_map_base.t().x(), 0.9, 0.05);
  EXPECT_TRUE(node().reset().success);
  track(4, 6);
  ASSERT_EQ(output.poses.size(), 6u);
  EXPECT_LT(output.poses[4].poses.T_map_base.t().norm(), 1e-9);
  // With twice the baseline everything is twice as far.
  EXPECT_NEAR(output.poses[5].poses.T_map_base.t().x(), 0.6, 0.1);
}

TEST_F(NodeLogicTest, ACalibrationThatCannotBeIsReportedOnce) {
  for (const Side side : {Side::kLeft, Side::kRight}) {
    node().add_camera_info(side, info_of(Side::kLeft));  // no baseline
  }
  track(0, 3);
  EXPECT_TRUE(output.poses.empty());
  EXPECT_EQ(output.count("P[3]"), 1);
  EXPECT_EQ(node().diagnostics().level, Diagnostics::Level::kError);
}

TEST_F(NodeLogicTest, ABagPlayedInALoopStartsAgain) {
  give_infos();
  track(0, 3);
  track(0, 3, 1600000000);
  EXPECT_EQ(output.count("time went back to 1600000000.000000000 s"), 1);
  ASSERT_EQ(output.poses.size(), 6u);
  EXPECT_LT(output.poses[3].poses.T_map_base.t().norm(), 1e-9);
  EXPECT_NEAR(output.poses[5].poses.T_odom_base.t().x(), 0.6, 0.03);
  EXPECT_EQ(node().path().size(), 3u);
}

TEST_F(NodeLogicTest, SavesItsMapAndStartsInIt) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "corridor.map").string();
  EXPECT_FALSE(node().save_map(file).success);
  EXPECT_FALSE(node().load_map(file, false).success);
  give_infos();
  track(0, 4);
  EXPECT_FALSE(node().save_map("").success);
  EXPECT_FALSE(node().save_map((folder.path() / "no" / "folder.map").string()).success);
  ASSERT_TRUE(node().save_map(file).success);
  track(4, 5);  // the run goes on
  EXPECT_NEAR(output.poses.back().poses.T_map_base.t().x(), 1.2, 0.04);
  const NodeLogic::Answer missing = node().load_map(file + ".not", false);
  EXPECT_FALSE(missing.success);
  EXPECT_NE(missing.message.find(".not"), std::string::npos);
  const auto loaded = node().load_map(file, true);
  ASSERT_TRUE(loaded.success) << loaded.message;
  output.poses.clear();
  track(2, 4, 1700001000);
  ASSERT_FALSE(output.poses.empty());  // found where it is in the map; odom begins here
  EXPECT_NEAR(output.poses.back().poses.T_map_base.t().x(), 0.9, 0.05);
  EXPECT_LT(output.poses.front().poses.T_odom_base.t().norm(), 1e-9);
}

TEST_F(NodeLogicTest, AMaskHidesWhatItCovers) {
  give_infos();
  const auto hide = [&](int width, int height, std::uint8_t value) {
    const GrayImage mask(width, height, value);
    for (const Side side : {Side::kLeft, Side::kRight}) {
      node().set_mask(side, message_of(mask, {}));
    }
  };
  hide(100, 100, 1);  // of another size
  track(0, 1);
  EXPECT_EQ(output.poses.size(), 1u);
  EXPECT_EQ(output.count("the mask of the left camera has 100x100 px, its images 400x122"), 1);
  hide(400, 122, 1);
  track(1, 2);
  EXPECT_EQ(output.poses.size(), 1u);  // lost
  EXPECT_EQ(node().diagnostics().level, Diagnostics::Level::kError);
  hide(400, 122, 0);
  track(2, 3);
  EXPECT_EQ(output.poses.size(), 2u);
}

TEST_F(NodeLogicTest, LabelImagesReachTheirFrame) {
  options.segments = true;
  settings.set("kys.mode", "verified");
  give_infos();
  const auto labels = [&](int i) {
    std::vector<std::uint16_t> values(400 * 122, 7000);
    const auto owner = std::make_shared<std::vector<std::uint8_t>>(values.size() * 2);
    std::memcpy(owner->data(), values.data(), owner->size());
    ImageMessage m;
    m.stamp = stamp(i);
    m.encoding = "16UC1";
    m.width = 400, m.height = 122, m.step = 800;
    m.data = *owner;
    m.owner = owner;
    return m;
  };
  node().add_segments(labels(0));  // before its frame
  track(0, 2);
  node().add_segments(labels(1));  // after it
  track(2, 3);
  EXPECT_EQ(output.poses.size(), 3u);
  EXPECT_EQ(output.count("label image"), 0);
  ImageMessage stray = labels(0);
  stray.stamp.nanosec += 5;
  node().add_segments(stray);
  EXPECT_EQ(output.count("label image whose stamp"), 1);
  ImageMessage small = labels(2);
  small.width = 300;
  node().add_segments(small);
  EXPECT_EQ(output.count("a map of 300x122 px"), 1);
  const Diagnostics state = node().diagnostics();
  EXPECT_EQ(value_of(state, "label images of no frame"), "1");
  EXPECT_EQ(value_of(state, "label images used"), "2");
}

TEST_F(NodeLogicTest, SegmentsNeedAModeWithPriors) {
  options.segments = true;
  EXPECT_THROW(node(), InputError);
}

TEST_F(NodeLogicTest, PairsThatCameTooFastAreCounted) {
  options.queue = 2;
  give_infos();
  for (int i = 0; i < kImages; ++i) give(i, stamp(i));
  while (node().track_next()) {
  }
  EXPECT_EQ(output.poses.size(), 2u);
  const Diagnostics state = node().diagnostics();
  EXPECT_EQ(value_of(state, "dropped pairs"), "4");
}

TEST_F(NodeLogicTest, TracksInAThreadUntilItIsStopped) {
  const TemporaryFolder folder;
  options.output = (folder.path() / "run").string();
  give_infos();
  std::thread thread([this] { node().run(); });
  for (int i = 0; i < 4; ++i) give(i, stamp(i));
  for (int k = 0; node().path().size() < 4 && k < 6000; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  node().stop();
  thread.join();
  node().finish();
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "run" / "trajectory.tum"));
}

TEST(PairCalibration, RawAndRectifiedPairs) {
  CameraInfo left = info_of(Side::kLeft), right = info_of(Side::kRight);
  left.D = right.D = {-0.05, 0.01, 0, 0, 0};
  CameraInfos infos;
  EXPECT_EQ(infos.missing(), "left and right");
  infos.add(Side::kLeft, left);
  EXPECT_EQ(infos.missing(), "right");
  infos.add(Side::kRight, right);
  EXPECT_TRUE(infos.complete());
  EXPECT_EQ(infos.add(Side::kRight, right), CameraInfos::Arrival::kSame);
  const PairCalibration raw = calibrate(infos, false, 400, 122);
  EXPECT_TRUE(raw.rectifier);
  EXPECT_NEAR(raw.camera.baseline, 0.537, 1e-6);
  const PairCalibration rectified = calibrate(infos, true, 400, 122);
  EXPECT_FALSE(rectified.rectifier);
  EXPECT_EQ(rectified.camera.fx, 232);
  EXPECT_NEAR(rectified.camera.baseline, 0.537, 1e-12);
  EXPECT_THROW(calibrate(infos, true, 640, 480), InputError);
}

/// Cameras that are turned against each other. The frame that is tracked has the right camera on
/// its x axis; poses of the robot are about the image of the messages.
TEST(PairCalibration, TheTrackedFrameIsThatOfTheMessagesTurned) {
  CameraInfo left = info_of(Side::kLeft), right = info_of(Side::kRight);
  const auto turn = [](CameraInfo& info, const Eigen::Vector3d& w) {
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = so3_exp(w).toRotationMatrix();
    std::copy_n(R.data(), 9, info.R.begin());
  };
  turn(left, {0.01, 0.03, -0.02});
  turn(right, {-0.01, -0.02, 0.01});
  CameraInfos infos;
  infos.add(Side::kLeft, left);
  infos.add(Side::kRight, right);
  const PairCalibration turned = calibrate(infos, false, 400, 122);
  ASSERT_TRUE(turned.rectifier);
  EXPECT_GT(rotation_angle(turned.T_raw_c), 0.01);
  // By R of the left camera: from its axes to those in which the right camera is at (0.537, 0, 0).
  const Eigen::Vector3d right_in_raw =
      so3_exp({0.01, 0.03, -0.02}).conjugate() * Eigen::Vector3d(0.537, 0, 0);
  EXPECT_LT((turned.T_raw_c.inverse() * right_in_raw - Eigen::Vector3d(0.537, 0, 0)).norm(), 1e-6);
}

}  // namespace
}  // namespace kys_slam::ros
