// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/read_bytes.h>

#include "temporary_folder.h"

namespace kys_slam {
namespace {

std::vector<TimedPose> sample() {
  std::vector<TimedPose> poses;
  for (int i = 0; i < 20; ++i) {
    poses.push_back({1403715273.262 + 0.05 * i, Rigid3(so3_exp({0.3 * i, -0.2 * i, 0.1}),
                                                       Eigen::Vector3d(i, -2.5 * i, 1e-3))});
  }
  return poses;
}

TEST(TrajectoryFile, TumSurvivesWritingAndReading) {
  const TemporaryFolder folder;
  const auto poses = sample();
  write_tum_poses(folder / "t.tum", poses);
  const auto read = read_tum_poses(folder / "t.tum");
  ASSERT_EQ(read.size(), poses.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_NEAR(read[i].timestamp, poses[i].timestamp, 1e-6);
    EXPECT_LT(minus(read[i].T_w_c, poses[i].T_w_c).norm(), 1e-8);
  }
  // What was read gives the same bytes again.
  EXPECT_EQ(format_tum(read), read_text(folder / "t.tum"));
}

TEST(TrajectoryFile, KittiSurvivesWritingAndReading) {
  const TemporaryFolder folder;
  std::vector<Rigid3> poses;
  for (const TimedPose& pose : sample()) poses.push_back(pose.T_w_c);
  write_kitti_poses(folder / "t.kitti", poses);
  const auto read = read_kitti_poses(folder / "t.kitti");
  ASSERT_EQ(read.size(), poses.size());
  for (std::size_t i = 0; i < read.size(); ++i) EXPECT_LT(minus(read[i], poses[i]).norm(), 1e-8);
}

TEST(TrajectoryFile, FormatIsFixed) {
  const TimedPose pose{1.5,
                       Rigid3(Eigen::Quaterniond(-1, 0, 0, 0), Eigen::Vector3d(-1e-17, 2, -3))};
  EXPECT_EQ(format_tum(std::span(&pose, 1)),
            "1.500000000 0.000000000 2.000000000 -3.000000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n");
  EXPECT_EQ(format_kitti(std::span(&pose.T_w_c, 1)),
            "1.000000000 0.000000000 0.000000000 0.000000000 0.000000000 1.000000000 0.000000000 "
            "2.000000000 0.000000000 0.000000000 1.000000000 -3.000000000\n");
}

TEST(TrajectoryFile, EurocQuaternionBeginsWithW) {
  const TemporaryFolder folder;
  write_text(folder / "gt.csv", "#timestamp\n2000000000,1,2,3,0.6,0.8,0,0,9,9\n");
  const auto poses = read_euroc_poses(folder / "gt.csv");
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_DOUBLE_EQ(poses[0].timestamp, 2.0);
  EXPECT_DOUBLE_EQ(poses[0].T_w_c.rotation.w(), 0.6);
  EXPECT_DOUBLE_EQ(poses[0].T_w_c.rotation.x(), 0.8);
}

TEST(TrajectoryFile, BadInputNamesFileAndLine) {
  const TemporaryFolder folder;
  const auto tum = [&](const std::string& text, std::initializer_list<std::string> parts) {
    write_text(folder / "t.tum", text);
    expect_input_error([&] { read_tum_poses(folder / "t.tum"); }, parts);
  };
  const std::string good = "1 0 0 0 0 0 0 1\n";
  tum("# c\n" + good + "2 0 0 nan 0 0 0 1\n", {"t.tum:3", "'nan'"});
  tum(good + "2 0 0 0 0 0 1\n", {"t.tum:2", "7 columns"});
  tum(good + good, {"t.tum:2", "increase"});
  tum(good + "2 0 0 0 0 0 0 0\n", {"t.tum:2", "unit length"});
  tum(good + "2 0 0 0x 0 0 0 1\n", {"t.tum:2", "'0x'"});
  tum(good + "2 0 -1e200 0 0 0 0 1\n", {"t.tum:2", "1e9 m away"});
  tum("1e999 0 0 0 0 0 0 1\n", {"t.tum:1"});
  write_text(folder / "t.tum", good + good);
  EXPECT_EQ(read_tum_poses(folder / "t.tum", Stamps::kMayRepeat).size(), 2u);
  write_text(folder / "k.txt", "1 0 0 0 0 1 0 0 0 0 -1 0\n");  // a mirror
  expect_input_error([&] { read_kitti_poses(folder / "k.txt"); }, {"k.txt:1", "rotation"});
  write_text(folder / "k.txt", "1 0 0 0 0 1 0 0 0 0 1 1e200\n");
  expect_input_error([&] { read_kitti_poses(folder / "k.txt"); }, {"k.txt:1", "1e9 m away"});
  expect_input_error([&] { read_kitti_poses(folder / "none.txt"); }, {"none.txt"});
  expect_input_error([&] { write_kitti_poses(folder / "no/k.txt", {}); }, {"cannot write"});
}

}  // namespace
}  // namespace kys_slam
