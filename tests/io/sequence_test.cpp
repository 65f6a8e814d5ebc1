// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/read_bytes.h>

#include "sequence_fixtures.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;

TEST(KittiOdometry, ReadsCameraFramesAndGroundTruth) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  const auto sequence = open_kitti_sequence(folder / "07/");
  EXPECT_EQ(sequence->name(), "07");
  EXPECT_EQ(sequence->camera(), (StereoCamera{60, 40, 700, 700, 30, 20, 0.5}));
  ASSERT_EQ(sequence->frame_count(), 5);
  EXPECT_EQ(sequence->frame(3).name, "000003");
  EXPECT_DOUBLE_EQ(sequence->frame(3).timestamp, 0.3);
  const StereoFrame frame = sequence->read(3);
  EXPECT_EQ(frame.index, 3);
  EXPECT_EQ(frame.left.at(0, 0), 13);
  EXPECT_EQ(frame.right.at(59, 39), 103);
  ASSERT_EQ(sequence->ground_truth().size(), 5u);
  EXPECT_DOUBLE_EQ(sequence->ground_truth()[4].T_w_c.t().z(), 4);
  int count = 0;
  while (const auto next = sequence->next()) EXPECT_EQ(next->index, count++);
  EXPECT_EQ(count, 5);
}

TEST(KittiOdometry, PartOfASequenceKeepsItsIndices) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  const auto sequence = open_kitti_sequence(folder / "07", {.start = 2, .frames = 2});
  ASSERT_EQ(sequence->frame_count(), 2);
  EXPECT_EQ(sequence->read(0).index, 2);
  EXPECT_EQ(sequence->read(1).name, "000003");
  ASSERT_EQ(sequence->ground_truth().size(), 2u);
  EXPECT_DOUBLE_EQ(sequence->ground_truth()[0].timestamp, 0.2);
  EXPECT_EQ(open_kitti_sequence(folder / "07", {.start = 4, .frames = 100})->frame_count(), 1);
  expect_input_error([&] { open_kitti_sequence(folder / "07", {.start = 5, .frames = {}}); },
                     {"start at frame 5 of 5"});
  expect_input_error([&] { open_kitti_sequence(folder / "07", {.start = 0, .frames = 0}); },
                     {"0 frames"});
}

TEST(KittiOdometry, FramesAreInOrderOfTheirNumbers) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  for (const char* camera : {"image_0", "image_1"}) {
    fs::remove_all(folder / "07" / camera);
    write_images(folder / "07" / camera, "%d.png", 12, 10);
    fs::rename(folder / "07" / camera / "11.png", folder / "07" / camera / "011.png");
  }
  std::string times, poses;
  for (int i = 0; i < 12; ++i) {
    times += std::to_string(i) + "\n";
    poses += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(i) + "\n";
  }
  write_text(folder / "07/times.txt", times);
  write_text(folder / "07/poses.txt", poses);
  const auto sequence = open_kitti_sequence(folder / "07");
  for (int i = 0; i < 11; ++i) EXPECT_EQ(sequence->frame(i).name, std::to_string(i));
  EXPECT_EQ(sequence->frame(11).name, "011");
  fs::copy(folder / "07/image_0/3.png", folder / "07/image_0/03.png");
  expect_input_error([&] { open_kitti_sequence(folder / "07"); }, {"3.png", "the same frame as"});
}

TEST(KittiOdometry, FractionsInNamesAreNoNumbersOfTheirOwn) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  const char* names[] = {"1.5.png", "2.05.png", "2.1.png", "10.25.png", "10.5.png"};
  for (const char* camera : {"image_0", "image_1"}) {
    for (int i = 0; i < 5; ++i) {
      fs::rename(folder / "07" / camera / numbered("%06d.png", i),
                 folder / "07" / camera / names[i]);
    }
  }
  const auto sequence = open_kitti_sequence(folder / "07");
  for (int i = 0; i < 5; ++i) EXPECT_EQ(sequence->frame(i).name + ".png", names[i]);
}

TEST(KittiOdometry, ColourPairMovesGroundTruthToItsLeftCamera) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "sequences/07", "image_2", "image_3");
  fs::create_directories(folder / "poses");
  // Turned by 90 degrees to the right (about y) and 1 m ahead.
  write_text(folder / "poses/07.txt",
             "1 0 0 0 0 1 0 0 0 0 1 0\n0 0 1 0 0 1 0 0 -1 0 0 1\n"
             "1 0 0 0 0 1 0 0 0 0 1 2\n1 0 0 0 0 1 0 0 0 0 1 3\n1 0 0 0 0 1 0 0 0 0 1 4\n");
  fs::remove(folder / "sequences/07/poses.txt");
  const auto sequence = open_kitti_sequence(folder / "sequences/07");
  EXPECT_DOUBLE_EQ(sequence->camera().baseline, 0.5);
  const auto& truth = sequence->ground_truth();
  ASSERT_EQ(truth.size(), 5u);
  EXPECT_NEAR(truth[0].T_w_c.t().norm(), 0, 1e-15);
  // Camera 2 stands 42/700 = 0.06 m to the left of camera 0: at (-0.06, 0, 0), and after the turn
  // at (0, 0, 1 + 0.06) of camera 0's world, which is (0.06, 0, 1.06) of camera 2's.
  EXPECT_NEAR((truth[1].T_w_c.t() - Eigen::Vector3d(0.06, 0, 1.06)).norm(), 0, 1e-12);
}

TEST(KittiOdometry, OptionChoosesThePair) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07", "image_2", "image_3");
  write_kitti_odometry(folder / "07");
  const auto first = open_sequence(folder / "07");
  const auto grey = open_sequence(folder / "07", {.frames = {}, .pair = CameraPair::kGrey});
  const auto colour = open_sequence(folder / "07", {.frames = {}, .pair = CameraPair::kColour});
  EXPECT_EQ(first->frame(0).left, grey->frame(0).left);
  EXPECT_EQ(colour->frame(0).left, folder / "07" / "image_2" / "000000.png");
  EXPECT_EQ(colour->frame(0).right, folder / "07" / "image_3" / "000000.png");
  EXPECT_EQ(parse_camera_pair("colour"), CameraPair::kColour);
  expect_input_error([] { parse_camera_pair("left"); }, {"left", "grey or colour"});
  fs::remove_all(folder / "07" / "image_3");
  expect_input_error(
      [&] { open_sequence(folder / "07", {.frames = {}, .pair = CameraPair::kColour}); },
      {"image_3"});
  write_euroc(folder / "V1");
  expect_input_error(
      [&] { open_sequence(folder / "V1", {.frames = {}, .pair = CameraPair::kGrey}); },
      {"one camera pair"});
}

class BadKitti : public ::testing::Test {
 protected:
  BadKitti() { write_kitti_odometry(sequence_); }
  void expect_refused(std::initializer_list<std::string> parts) {
    expect_input_error([this] { open_kitti_sequence(sequence_); }, parts);
  }
  const TemporaryFolder folder_;
  const fs::path sequence_ = folder_ / "07";
};

TEST_F(BadKitti, Folder) {
  expect_input_error([&] { open_kitti_sequence(folder_ / "08"); }, {"08", "no such folder"});
  expect_input_error([&] { open_kitti_sequence(sequence_ / "times.txt"); }, {"not a folder"});
  expect_input_error([&] { open_kitti_sequence(folder_.path()); }, {"not a KITTI sequence"});
}

TEST_F(BadKitti, Calibration) {
  fs::remove(sequence_ / "calib.txt");
  expect_refused({"calib.txt"});
  write_text(sequence_ / "calib.txt", "P0: 700 0 30 0 0 700 20 0 0 0 1 0\n");
  expect_refused({"calib.txt", "P1"});
  write_text(sequence_ / "calib.txt",
             "P0: nan 0 30 0 0 700 20 0 0 0 1 0\nP1: 700 0 30 -350 0 700 20 0 0 0 1 0\n");
  expect_refused({"calib.txt:1", "not a finite number"});
  write_text(sequence_ / "calib.txt",
             "P0: 700 0 30 0 0 700 20 0 0 0 1 0\nP1: 700 0 30 350 0 700 20 0 0 0 1 0\n");
  expect_refused({"calib.txt", "right"});
  write_text(sequence_ / "calib.txt",
             "P0: 700 0 30 0 0 700 20 0 0 0 1\nP1: 700 0 30 350 0 700 20 0 0 0 1 0\n");
  expect_refused({"calib.txt:1", "11 numbers"});
  const std::string calibration = kKittiCalibration;
  write_text(sequence_ / "calib.txt", calibration + calibration);
  open_kitti_sequence(sequence_);  // the same again
  write_text(sequence_ / "calib.txt", calibration + "P0: 600 0 30 0 0 600 20 0 0 0 1 0\n");
  expect_refused({"calib.txt:5", "another P0"});
}

TEST_F(BadKitti, Times) {
  write_text(sequence_ / "times.txt", "0\n0.1\n0.2\n0.3\n");
  expect_refused({"times.txt", "4 time stamps", "5 images"});
  write_text(sequence_ / "times.txt", "0\n0.1\n0.1\n0.3\n0.4\n");
  expect_refused({"times.txt:3", "do not increase"});
  write_text(sequence_ / "times.txt", "0\n0.1\ninf\n0.3\n0.4\n");
  expect_refused({"times.txt:3", "finite"});
  fs::remove(sequence_ / "times.txt");
  expect_refused({"times.txt"});
}

TEST_F(BadKitti, ImagesArePairedByAllNumbersInTheirNames) {
  const auto rename = [&](const char* camera, const char* pattern) {
    fs::remove_all(sequence_ / camera);
    write_images(sequence_ / camera, pattern, 6, 10);
  };
  rename("image_0", "%06d_10.png");
  rename("image_1", "%06d_10.png");
  fs::remove(sequence_ / "image_0/000003_10.png");
  fs::remove(sequence_ / "image_1/000004_10.png");
  const auto sequence = open_kitti_sequence(sequence_);
  ASSERT_EQ(sequence->frame_count(), 4);  // 0 1 2 5
  EXPECT_EQ(sequence->dropped(), 2);
  EXPECT_EQ(sequence->frame(3).left.filename(), "000005_10.png");
  EXPECT_EQ(sequence->frame(3).right.filename(), "000005_10.png");
  // The number of the camera may be in the names.
  rename("image_0", "cam0_%06d.png");
  rename("image_1", "cam1_%06d.png");
  fs::remove(sequence_ / "image_0/cam0_000005.png");
  fs::remove(sequence_ / "image_1/cam1_000005.png");
  EXPECT_EQ(open_kitti_sequence(sequence_)->frame_count(), 5);
}

TEST_F(BadKitti, RightCamera) {
  fs::remove(sequence_ / "image_1/000002.png");
  // The frame is left out; those after it keep their time and their pose.
  const auto sequence = open_kitti_sequence(sequence_);
  ASSERT_EQ(sequence->frame_count(), 4);
  EXPECT_EQ(sequence->dropped(), 1);
  EXPECT_EQ(sequence->frame(2).name, "000003");
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.3);
  EXPECT_DOUBLE_EQ(sequence->ground_truth()[2].T_w_c.t().z(), 3);
  fs::remove(sequence_ / "image_1/000001.png");
  fs::remove(sequence_ / "image_1/000004.png");
  expect_refused({"image_1", "2 images", "image_0 has 5", "only 2"});
  fs::remove_all(sequence_ / "image_1");
  expect_refused({"image_1"});
}

TEST_F(BadKitti, TwoImagesOfOneFrame) {
  for (const char* camera : {"image_0", "image_1"}) {
    fs::copy(sequence_ / camera / "000003.png", sequence_ / camera / "000003.jpeg");
  }
  expect_refused({"000003.png", "the same frame as 000003.jpeg"});
}

TEST_F(BadKitti, GroundTruth) {
  write_text(sequence_ / "poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  expect_refused({"poses.txt", "1 poses", "5 images"});
  write_text(sequence_ / "poses.txt", "2 0 0 0 0 1 0 0 0 0 1 0\n");
  expect_refused({"poses.txt:1", "rotation"});
}

TEST_F(BadKitti, ImagesAreReportedAtTheirFrameAndTheRestIsRead) {
  write_png(sequence_ / "image_1/000001.png", GrayImage(61, 40));
  const auto png = read_text(sequence_ / "image_0/000003.png");
  write_text(sequence_ / "image_0/000003.png", png.substr(0, png.size() / 2));
  const auto sequence = open_kitti_sequence(sequence_);
  EXPECT_EQ(sequence->next()->index, 0);
  expect_input_error([&] { (void)sequence->next(); }, {"image_1/000001.png", "61x40", "60x40"});
  EXPECT_EQ(sequence->next()->index, 2);
  expect_input_error([&] { (void)sequence->next(); }, {"image_0/000003.png"});
  EXPECT_EQ(sequence->next()->index, 4);
  EXPECT_FALSE(sequence->next());
}

TEST(KittiTracking, GroundTruthFromOxtsIsOfTheLeftCamera) {
  const TemporaryFolder folder;
  const fs::path root = folder / "training";
  write_images(root / "image_02/0001", "%06d.png", 3, 10);
  write_images(root / "image_03/0001", "%06d.png", 3, 100);
  // Axes only: imu x forward, y left, z up; camera x right, y down, z forward. No lever arms.
  write_text(root / "calib/0001.txt",
             std::string(kKittiCalibration) +
                 "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0\n"
                 "Tr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0\n");
  // On the equator, heading east (yaw 0): 1e-5 degrees of longitude are 1.113 m ahead.
  std::string oxts;
  for (const char* longitude : {"8.00000", "8.00001", "8.00002"}) {
    oxts += std::string("0.0 ") + longitude + " 100 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n";
  }
  write_text(root / "oxts/0001.txt", oxts);
  const auto sequence = open_kitti_sequence(root / "image_02/0001");
  EXPECT_EQ(sequence->layout(), "KITTI Tracking");
  EXPECT_DOUBLE_EQ(sequence->camera().baseline, 0.5);
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.2);
  ASSERT_EQ(sequence->ground_truth().size(), 3u);
  const Rigid3& T = sequence->ground_truth()[2].T_w_c;
  const double metres = 2e-5 * 3.14159265358979 / 180 * 6378137;
  EXPECT_NEAR((T.t() - Eigen::Vector3d(0, 0, metres)).norm(), 0, 1e-6);
  EXPECT_NEAR(rotation_angle(T), 0, 1e-12);
  write_text(root / "oxts/0001.txt", "0 8 1\n");
  expect_input_error([&] { open_kitti_sequence(root / "image_02/0001"); }, {"oxts/0001.txt"});
  write_text(root / "oxts/0001.txt", oxts);
  for (const auto& [row, rest] :
       {std::pair{"R_rect 2 0 0 0 1 0 0 0 1\n",
                  "Tr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0\nTr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0\n"},
        {"Tr_velo_cam 0 0 0 0 0 0 0 0 0 0 0 0\n",
         "R_rect 1 0 0 0 1 0 0 0 1\nTr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0\n"},
        {"Tr_imu_velo 1 0 0 0 0 1 0 0 0 0 -1 0\n",
         "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0\n"}}) {
    write_text(root / "calib/0001.txt", std::string(kKittiCalibration) + row + rest);
    expect_input_error([&] { open_kitti_sequence(root / "image_02/0001"); },
                       {"calib/0001.txt", std::string(row, 6), "no rotation"});
  }
}

TEST(KittiTracking, FramesThatAreMissingLeaveTheOthersTheirTimes) {
  const TemporaryFolder folder;
  const fs::path root = folder / "training";
  write_text(root / "calib/0001.txt", kKittiCalibration);
  for (const char* camera : {"image_02", "image_03"}) {
    write_images(root / camera / "0001", "%06d.png", 6, 10);
    fs::remove(root / camera / "0001/000003.png");
    fs::remove(root / camera / "0001/000004.png");
  }
  fs::remove(root / "image_03/0001/000001.png");
  const auto sequence = open_kitti_sequence(root / "image_02/0001");
  ASSERT_EQ(sequence->frame_count(), 3);  // 0 2 5
  EXPECT_DOUBLE_EQ(sequence->frame(1).timestamp, 0.2);
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.5);
  EXPECT_EQ(sequence->dropped(), 1);
}

TEST(VirtualKitti, ReadsIntrinsicsAndWorldToCameraPoses) {
  const TemporaryFolder folder;
  const fs::path root = folder / "Scene01/clone";
  write_images(root / "frames/rgb/Camera_0", "rgb_%05d.png", 3, 10);
  write_images(root / "frames/rgb/Camera_1", "rgb_%05d.png", 3, 100);
  std::string intrinsic = "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n";
  std::string extrinsic =
      "frame cameraID r1,1 r1,2 r1,3 t1 r2,1 r2,2 r2,3 t2 r3,1 r3,2 r3,3 t3 0 0 0 1\n";
  for (int i = 0; i < 3; ++i) {
    for (int c = 0; c < 2; ++c) {
      intrinsic += std::to_string(i) + " " + std::to_string(c) + " 725.0 725.0 29.5 19.5\n";
      // World to camera of a camera at (c * 0.5, 0, 7 + i); the first is rounded badly.
      extrinsic += std::to_string(i) + " " + std::to_string(c) + " 1 0 0 " +
                   (c == 0   ? "0"
                    : i == 0 ? "-0.5002"
                             : "-0.5") +
                   " 0 1 0 0 0 0 1 " + std::to_string(-7 - i) + " 0 0 0 1\n";
    }
  }
  write_text(root / "intrinsic.txt", intrinsic);
  write_text(root / "extrinsic.txt", extrinsic);
  const auto sequence = open_kitti_sequence(root);
  EXPECT_EQ(sequence->name(), "Scene01-clone");
  EXPECT_EQ(sequence->frame(1).name, "rgb_00001");
  EXPECT_EQ(sequence->camera(), (StereoCamera{60, 40, 725, 725, 29.5, 19.5, 0.5}));
  ASSERT_EQ(sequence->ground_truth().size(), 3u);
  EXPECT_NEAR((sequence->ground_truth()[2].T_w_c.t() - Eigen::Vector3d(0, 0, 2)).norm(), 0, 1e-12);
  fs::remove(root / "frames/rgb/Camera_0/rgb_00001.png");
  fs::remove(root / "frames/rgb/Camera_1/rgb_00001.png");
  EXPECT_DOUBLE_EQ(open_kitti_sequence(root)->frame(1).timestamp, 0.2);
  write_text(root / "extrinsic.txt", extrinsic + "1 0 1 0 0 9 0 1 0 0 0 0 1 0 0 0 0 1\n");
  expect_input_error([&] { open_kitti_sequence(root); }, {"extrinsic.txt:8", "second"});
  write_text(root / "extrinsic.txt", "frame cameraID\n0 0 1 2 3\n");
  expect_input_error([&] { open_kitti_sequence(root); }, {"extrinsic.txt:2", "columns"});
}

/// Of images of 60x40 px, rectified.
StereoRig write_pair_rig(const TemporaryFolder& folder) {
  write_text(folder / "rig.yaml",
             "left: {width: 60, height: 40, fx: 50, fy: 50, cx: 30, cy: 20}\n"
             "right: {width: 60, height: 40, fx: 50, fy: 50, cx: 30, cy: 20}\n"
             "T_left_right: [1, 0, 0, 0.2,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]\n");
  return read_stereo_rig(std::vector<fs::path>{folder / "rig.yaml"});
}

TEST(ImagePair, ALostImageDoesNotShiftThePairsAfterIt) {
  const TemporaryFolder folder;
  const StereoRig rig = write_pair_rig(folder);
  for (int i = 0; i < 5; ++i) {  // 50 ms apart, the right ones 2 ms later
    fs::create_directories(folder / "left");
    fs::create_directories(folder / "right");
    const std::int64_t stamp = 1403715273262142976 + 50000000LL * i;
    const GrayImage image(60, 40, std::uint8_t(i));
    write_png(folder / ("left/" + std::to_string(stamp) + ".png"), image);
    if (i != 1) write_png(folder / ("right/" + std::to_string(stamp + 2000000) + ".png"), image);
  }
  ImagePairOptions options;
  options.part.pairing_tolerance = 0.06;
  const auto sequence = open_image_pair(folder / "left", folder / "right", rig, options);
  ASSERT_EQ(sequence->frame_count(), 4);
  EXPECT_EQ(sequence->dropped(), 1);
  for (int i = 0; i < 4; ++i) {
    const StereoFrame frame = sequence->read(i);
    EXPECT_EQ(frame.left.at(30, 20), frame.right.at(30, 20));
  }
}

TEST(ImagePair, AnAbsurdCalibrationNamesItsFile) {
  const TemporaryFolder folder;
  for (const char* side : {"left", "right"}) {
    fs::create_directories(folder / side);
    write_png(folder / side / "0.png", GrayImage(60, 40));
  }
  write_text(folder / "rig.yaml",
             "left: {width: 60, height: 40, fx: 0.5, fy: 0.5, cx: 30, cy: 20}\n"
             "right: {width: 60, height: 40, fx: 0.5, fy: 0.5, cx: 30, cy: 20}\n"
             "T_left_right: [1, 0, 0, 0.2,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]\n");
  const StereoRig rig = read_stereo_rig(std::vector<fs::path>{folder / "rig.yaml"});
  ImagePairOptions options;
  options.rate = 10;
  expect_input_error([&] { open_image_pair(folder / "left", folder / "right", rig, options); },
                     {"rig.yaml", "focal length of 0.5 px"});
}

TEST(ImagePair, UnitOfTheTimeStampsInNames) {
  const TemporaryFolder folder;
  const StereoRig rig = write_pair_rig(folder);
  int count = 0;
  const auto open = [&](std::int64_t first, std::int64_t apart) {
    const fs::path root = folder / std::to_string(count++);
    for (const char* side : {"left", "right"}) {
      fs::create_directories(root / side);
      for (int i = 0; i < 3; ++i) {
        write_png(root / side / (std::to_string(first + apart * i) + ".png"),
                  GrayImage(60, 40, std::uint8_t(i)));
      }
    }
    return open_image_pair(root / "left", root / "right", rig);
  };
  struct Row {
    std::int64_t first, apart;
    double seconds, seconds_apart;
  };
  for (const Row& row :
       {Row{1403715273262142976, 50'000'000, 1403715273.262142976, 0.05},  // ns
        Row{1403715273262142, 50'000, 1403715273.262142, 0.05},            // us
        Row{1403715273262142, 900'000, 1403715273.262142, 0.9},
        Row{1403715273262, 50, 1403715273.262, 0.05},          // ms
        Row{1403715273262, 50'000'000, 1403.715273262, 0.05},  // ns since the start
        Row{3403715273262142, 50'000'000, 3403715.273262142, 0.05},
        Row{34037152732621, 5'000'000, 34037.152732621, 0.005}}) {
    const auto sequence = open(row.first, row.apart);
    EXPECT_TRUE(sequence->paired_by_time());
    ASSERT_EQ(sequence->frame_count(), 3) << row.first;
    EXPECT_NEAR(sequence->frame(0).timestamp, row.seconds, 1e-6) << row.first;
    EXPECT_NEAR(sequence->frame(2).timestamp, row.seconds + 2 * row.seconds_apart, 1e-6);
  }
  // 5 s in us, or 5 ms in ns.
  expect_input_error([&] { open(1403715273262142, 5'000'000); }, {"1403715273262142.png", "us"});
  for (const std::int64_t date : {20261125161700L, 1L}) {  // 1 s apart as a date; frame numbers
    expect_input_error([&] { open(date, 1); }, {"--rate or --times"});
  }
}

TEST(ImagePair, RateAndTimesExcludeEachOther) {
  const TemporaryFolder folder;
  ImagePairOptions options;
  options.rate = 10;
  options.times = folder / "times.txt";
  expect_input_error(
      [&] { open_image_pair(folder.path(), folder.path(), write_pair_rig(folder), options); },
      {"--rate", "--times"});
}

TEST(Euroc, PairsByTimeAndCountsWhatHasNoPartner) {
  const TemporaryFolder folder;
  write_euroc(folder / "V9_01");
  const auto sequence = open_euroc_sequence(folder / "V9_01");
  EXPECT_EQ(sequence->name(), "V9_01");
  ASSERT_EQ(sequence->frame_count(), 4);  // 0 1 3 5
  EXPECT_EQ(sequence->dropped(), 2);
  EXPECT_EQ(sequence->frame(2).name, std::to_string(1403715273262142976 + 150000000LL));
  EXPECT_NEAR(sequence->frame(2).timestamp, 1403715273.412142976, 1e-6);
  const StereoFrame frame = sequence->read(3);
  EXPECT_EQ(frame.left.at(30, 20), 55);
  EXPECT_EQ(frame.right.at(30, 20), 55);
  expect_input_error(
      [&] {
        open_euroc_sequence(folder / "V9_01",
                            {.start = 0, .frames = {}, .pairing_tolerance = 1e-7});
      },
      {"cam1/data.csv", "5 left and 5 right", "1e-06 s apart", "--tolerance"});
  // With a tolerance above the interval, lost images do not shift the pairs after them.
  const auto loose =
      open_euroc_sequence(folder / "V9_01", {.start = 0, .frames = {}, .pairing_tolerance = 0.06});
  ASSERT_EQ(loose->frame_count(), 4);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(loose->frame(i).name, sequence->frame(i).name);
    EXPECT_EQ(loose->read(i).left.at(30, 20), loose->read(i).right.at(30, 20));
  }
}

TEST(Euroc, GroundTruthMovesFromTheBodyToTheRectifiedLeftCamera) {
  const TemporaryFolder folder;
  write_euroc(folder / "V9_01");
  const auto sequence = open_euroc_sequence(folder / "V9_01/mav0");
  EXPECT_EQ(sequence->name(), "V9_01");
  ASSERT_TRUE(sequence->T_b_c());
  // The cameras stand side by side already, so rectification does not turn them: body x is the
  // camera's -y, body y the camera's x.
  const Eigen::Vector3d right_in_body = sequence->T_b_c()->rotation * Eigen::Vector3d::UnitX();
  EXPECT_NEAR((right_in_body - Eigen::Vector3d::UnitY()).norm(), 0, 1e-9);
  ASSERT_EQ(sequence->ground_truth().size(), 2u);
  const TimedPose& pose = sequence->ground_truth()[1];
  EXPECT_NEAR(pose.timestamp, 1403715273.267142976, 1e-6);
  EXPECT_NEAR((pose.T_w_c.t() - Eigen::Vector3d(1.5, 2, 3)).norm(), 0, 1e-9);
  EXPECT_NEAR((pose.T_w_c.rotation * Eigen::Vector3d::UnitX() - right_in_body).norm(), 0, 1e-9);
  EXPECT_NEAR(sequence->camera().baseline, 0.1, 1e-9);
}

TEST(Euroc, BadInput) {
  const TemporaryFolder folder;
  const fs::path root = folder / "V9_01";
  const auto expect_refused = [&](std::initializer_list<std::string> parts) {
    expect_input_error([&] { open_euroc_sequence(root); }, parts);
    fs::remove_all(root);
    write_euroc(root);
  };
  expect_refused({"V9_01"});
  write_text(root / "mav0/cam0/sensor.yaml", sensor_yaml("0.0", ".nan, 50.0, 29.5, 19.5"));
  expect_refused({"cam0/sensor.yaml", "intrinsics", "finite"});
  write_text(root / "mav0/cam0/sensor.yaml", "a: [1, 2");
  expect_refused({"cam0/sensor.yaml"});
  const std::string sound = sensor_yaml("0.0", "50.0, 50.0, 29.5, 19.5");
  write_text(root / "mav0/cam0/sensor.yaml", sound + "\nresolution: [60, 40]\n");
  expect_refused({"cam0/sensor.yaml", "the key 'resolution' is there twice"});
  std::string scaled = sound;
  scaled.replace(scaled.find("0.0, 0.0, 0.0, 1.0]"), 19, "0.0, 0.0, 0.0, 2.0]");
  write_text(root / "mav0/cam0/sensor.yaml", scaled);
  expect_refused({"cam0/sensor.yaml", "last row of 'T_BS'"});
  fs::remove(root / "mav0/cam1/sensor.yaml");
  expect_refused({"cam1/sensor.yaml"});
  write_text(root / "mav0/cam1/sensor.yaml", sensor_yaml("-0.1", "50.0, 50.0, 29.5, 19.5"));
  expect_refused({"cam1 to the right"});
  write_text(root / "mav0/cam1/data.csv", "50000000,x.png\n150000000,y.png\n");
  expect_refused({"cam1/data.csv:1", "x.png", "2 of 2"});
  write_text(root / "mav0/cam1/data.csv", "five,x.png\n");
  expect_refused({"cam1/data.csv:1", "not a finite number"});
  write_text(root / "mav0/cam1/data.csv", "5,../../x.png\n");
  expect_refused({"cam1/data.csv:1", "folder"});
  const std::string stamp = "1403715273262142976";
  write_text(root / "mav0/cam0/data.csv",
             stamp + "," + stamp + ".png\n" + stamp + "," + stamp + ".png\n");
  expect_refused({"cam0/data.csv:2", "twice"});
  fs::copy(root / "mav0/cam0/data" / (stamp + ".png"), root / "mav0/cam0/data/copy.png");
  write_text(root / "mav0/cam0/data.csv", stamp + "," + stamp + ".png\n" + stamp + ",copy.png\n");
  expect_refused({"cam0/data.csv:2", "increase"});
  fs::copy(root / "mav0/cam0/data" / (stamp + ".png"), root / "mav0/cam0/data/copy.png");
  write_text(root / "mav0/cam0/data.csv",
             stamp + "," + stamp + ".png\n1403715273262142996,copy.png\n");
  expect_refused({"cam0/data.csv:2", "20 ns"});
  for (const char* text : {"", "#timestamp, p_RS_R_x [m]\n"}) {
    write_text(root / "mav0/state_groundtruth_estimate0/data.csv", text);
    expect_refused({"state_groundtruth_estimate0/data.csv", "no poses"});
  }
}

TEST(RealExcerpts, OpenAndRead) {
  if (!fs::exists(shared_data() / "kitti_06_clip")) GTEST_SKIP() << "no " << shared_data();
  const auto kitti = open_kitti_sequence(shared_data() / "kitti_06_clip");
  EXPECT_EQ(kitti->frame_count(), 51);
  EXPECT_EQ(kitti->ground_truth().size(), 51u);
  EXPECT_NEAR(kitti->camera().bf(), 379.8145, 1e-9);
  EXPECT_EQ(kitti->read(50).left.width(), 1226);
  const auto euroc = open_euroc_sequence(shared_data() / "euroc_v101_start");
  EXPECT_EQ(euroc->frame_count(), 60);
  EXPECT_EQ(euroc->dropped(), 0);
  EXPECT_NEAR(euroc->camera().baseline, 0.110078, 1e-6);
  EXPECT_EQ(euroc->read(0).right.height(), 480);
  EXPECT_EQ(open_euroc_sequence(shared_data() / "euroc_v101_keyframes")->frame_count(), 100);
}

}  // namespace
}  // namespace kys_slam
