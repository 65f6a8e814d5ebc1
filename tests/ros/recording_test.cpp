// SPDX-License-Identifier: BSD-3-Clause
// Raw images of a drone through the node, against the system fed with the same images as a
// sequence.
#include <gtest/gtest.h>
#include <kys_slam/image_file.h>
#include <kys_slam/sequence.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "node_logic.h"

namespace kys_slam::ros {
namespace {

constexpr int kDroneFrames = 20;

struct PoseList : NodeOutput {
  void publish(const PoseOutput& pose) override { poses.push_back(pose); }
  void log(Level, const std::string& text) override { ADD_FAILURE() << text; }
  std::vector<PoseOutput> poses;
};

/// What a driver publishes for a camera of a calibrated pair.
CameraInfo driver_info(const RawCamera& raw, const StereoRectifier& rectifier, Side side) {
  const StereoCamera& c = rectifier.camera();
  CameraInfo info;
  info.width = raw.width;
  info.height = raw.height;
  info.distortion_model = "plumb_bob";
  info.D = raw.distortion;
  info.D.resize(5, 0);
  info.K = {raw.fx, 0, raw.cx, 0, raw.fy, raw.cy, 0, 0, 1};
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R =
      (rectifier.T_b_c().inverse() * raw.T_b_s).R();  // raw to rectified
  std::copy_n(R.data(), 9, info.R.begin());
  const double shift = side == Side::kRight ? -c.fx * c.baseline : 0;
  info.P = {c.fx, 0, c.cx, shift, 0, c.fy, c.cy, 0, 0, 0, 1, 0};
  return info;
}

TEST(NodeWithARecording, TracksRawImagesAsTheSequenceOfTheSameImages) {
  const char* chosen = std::getenv("KYS_SHARED_DATA_DIR");
  const std::filesystem::path data = chosen != nullptr ? chosen : KYS_SHARED_DATA_DIR;
  const std::filesystem::path folder = data / "euroc_v101_start";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  SequenceOptions part;
  part.frames = kDroneFrames;
  const auto sequence = open_euroc_sequence(folder, part);
  const std::array cameras{read_sensor_yaml(folder / "mav0" / "cam0" / "sensor.yaml"),
                           read_sensor_yaml(folder / "mav0" / "cam1" / "sensor.yaml")};
  const StereoRectifier rectifier(cameras[0], cameras[1], "euroc");

  NodeOptions options;
  options.schedule = Schedule::kSequential;
  PoseList output;
  NodeLogic node(options, Settings::indoor(), output);
  for (const Side side : {Side::kLeft, Side::kRight}) {
    node.add_camera_info(side,
                         driver_info(cameras[static_cast<std::size_t>(side)], rectifier, side));
  }
  System system(sequence->camera(), Settings::indoor(), Schedule::kSequential);
  // base_link is the raw left camera, with the axes of a body.
  const Rigid3 T_base_c = optical_to_body() * (cameras[0].T_b_s.inverse() * rectifier.T_b_c());
  for (int i = 0; i < kDroneFrames; ++i) {
    const Sequence::Frame& files = sequence->frame(i);
    for (const Side side : {Side::kLeft, Side::kRight}) {
      const GrayImage image = read_gray(side == Side::kLeft ? files.left : files.right);
      ImageMessage message;
      const auto stamp = std::stoll(files.name);  // ns
      message.stamp = {static_cast<std::int32_t>(stamp / 1000000000),
                       static_cast<std::uint32_t>(stamp % 1000000000)};
      message.encoding = "mono8";
      message.width = static_cast<std::uint32_t>(image.width());
      message.height = static_cast<std::uint32_t>(image.height());
      message.step = message.width;
      const auto owner = std::make_shared<const GrayImage>(image);
      message.data = {owner->data(), owner->size()};
      message.owner = owner;
      node.add_image(side, std::move(message));
    }
    ASSERT_TRUE(node.track_next());
    const FrameReport report = system.feed(sequence->read(i));
    ASSERT_EQ(output.poses.size(), static_cast<std::size_t>(i) + 1) << report.reason;
    const Rigid3 expected = T_base_c * report.T_w_c * T_base_c.inverse();
    const Rigid3& T_map_base = output.poses.back().poses.T_map_base;
    EXPECT_LT((T_map_base.t() - expected.t()).norm(), 1e-6) << "m, frame " << i;
    EXPECT_LT(rotation_angle(T_map_base.inverse() * expected), 1e-6) << "rad, frame " << i;
  }
}

}  // namespace
}  // namespace kys_slam::ros
