// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/check_pair.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/system.h>

#include "io/temporary_folder.h"
#include "support/rendered_corridor.h"

// Pixels and calibrations as a robot's program may give them.
namespace kys_slam {
namespace {

using testing::RenderedCorridor;

const StereoCamera kSmall{400, 122, 232, 232, 199.5, 60.5, 0.537};

TEST(ForeignViews, ABaselineInMillimetresIsRefused) {
  for (const double baseline : {537.0, 5.1, 0.0004}) {
    StereoCamera camera = kSmall;
    camera.baseline = baseline;
    expect_input_error([&] { System(camera, Settings(), Schedule::kSequential); },
                       {"the baseline is", "0.005 to 5 m"});
  }
}

std::vector<std::uint16_t> deep(const GrayImage& image, int bits) {
  std::vector<std::uint16_t> pixels;
  for (std::size_t i = 0; i < image.size(); ++i) {
    pixels.push_back(static_cast<std::uint16_t>(image.data()[i] << (bits - 8)));
  }
  return pixels;
}

TEST(ForeignViews, SixteenBitsAreReadByTheBitsInUse) {
  const RenderedCorridor corridor(kSmall, 12);
  const auto track = [&](int bits, std::string& warning) {
    System system(kSmall, Settings(), Schedule::kSequential);
    for (int i = 0; i < 4; ++i) {
      const StereoFrame frame =
          corridor.look(i, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.5 * i)});
      const auto left = deep(frame.left, bits), right = deep(frame.right, bits);
      const FrameReport report = system.feed(0.1 * i, {left.data(), 400, 122, PixelFormat::kGray16},
                                             {right.data(), 400, 122, PixelFormat::kGray16});
      EXPECT_NE(report.status, FrameStatus::kLost) << bits;
      EXPECT_EQ(report.warning.empty(), i > 0 || bits == 16) << report.warning;
      if (i == 0) warning = report.warning;
    }
    return system.trajectory();
  };
  std::string warning;
  const auto reference = track(16, warning);
  EXPECT_EQ(warning, "");
  for (const int bits : {8, 10, 12, 14}) {
    const auto found = track(bits, warning);
    EXPECT_NE(warning.find(std::to_string(bits) + " bits"), std::string::npos) << warning;
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_EQ(found[i].T_w_c.translation, reference[i].T_w_c.translation) << bits;
    }
  }
}

GrayImage encoded_again(const GrayImage& image, int quality) {
  return decode_gray(encode_jpeg(image, quality), "image");
}

/// The corridor through cameras whose distance is `baseline`.
class OneImage : public ::testing::Test {
 protected:
  static StereoFrame look(int i, double baseline) {
    StereoCamera camera = kSmall;
    camera.baseline = baseline;
    return RenderedCorridor(camera, 12)
        .look(i, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.5 * i)});
  }
};

TEST_F(OneImage, EncodedAgainOrNotIsRefusedFromTheStart) {
  for (const int quality : {100, 90, 60}) {
    System system(kSmall, Settings(), Schedule::kSequential);
    const auto feed = [&](int i) {
      StereoFrame frame = look(i, kSmall.baseline);
      frame.right = quality == 100 ? frame.left : encoded_again(frame.left, quality);
      return system.feed(frame);
    };
    for (int i = 0; i < 4; ++i) {
      const FrameReport report = feed(i);
      EXPECT_EQ(report.status, FrameStatus::kLost) << quality;
      EXPECT_EQ(report.reason, "the left and the right image are the same image");
      EXPECT_EQ(report.warning, report.reason);
    }
    expect_input_error([&] { feed(4); }, {"frame", "4", "same image", "two cameras"});
    // A camera that wakes up late is one.
    EXPECT_EQ(system.feed(look(5, kSmall.baseline)).status, FrameStatus::kStarted);
  }
}

TEST_F(OneImage, InTheMiddleCostsItsFrame) {
  System system(kSmall, Settings(), Schedule::kSequential);
  for (int i = 0; i < 8; ++i) {
    StereoFrame frame = look(i, kSmall.baseline);
    const bool same = i == 3 || i == 5;
    if (i == 3) frame.right = encoded_again(frame.left, 80);
    if (i == 5) frame.left = frame.right;
    const FrameReport report = system.feed(frame);
    EXPECT_EQ(report.status == FrameStatus::kLost, same) << i << report.reason;
    EXPECT_EQ(report.reason.find("same image") != std::string::npos, same) << i;
  }
  system.finish();
  const auto trajectory = system.trajectory();
  EXPECT_NEAR(trajectory[7].T_w_c.t().z() - trajectory[0].T_w_c.t().z(), 3.5, 0.05);
}

TEST_F(OneImage, FarScenesAreTwo) {
  // The walls stand at 7 m; disparities in the last run are 0.3 px and less.
  for (const double baseline : {0.537, 0.05, 0.02}) {
    System system(kSmall, Settings(), Schedule::kSequential);
    for (int i = 0; i < 6; ++i) {
      const FrameReport report = system.feed(look(i, baseline));
      EXPECT_EQ(report.reason.find("same image"), std::string::npos) << baseline;
    }
  }
}

TEST(ForeignViews, ACalibrationOfOtherImagesIsToldInTheFirstReport) {
  StereoCamera camera = kSmall;
  camera.fx *= 2, camera.fy *= 2, camera.cx *= 2, camera.cy *= 2;
  const RenderedCorridor corridor(kSmall, 12);
  System system(camera, Settings(), Schedule::kSequential);
  for (int i = 0; i < 2; ++i) {
    const StereoFrame frame =
        corridor.look(i, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.5 * i)});
    const FrameReport report = system.feed(frame);
    EXPECT_EQ(report.warning.find("by 0.5") != std::string::npos, i == 0) << report.warning;
  }
}

TEST(ForeignViews, StretchedPixelsAndTimesInMillisecondsAreTold) {
  StereoCamera camera = kSmall;
  camera.fy /= 2;
  const RenderedCorridor corridor(kSmall, 12);
  System system(camera, Settings(), Schedule::kSequential);
  for (int i = 0; i < 6; ++i) {
    StereoFrame frame =
        corridor.look(i, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.1 * i)});
    frame.timestamp = 100 * i;
    const FrameReport report = system.feed(frame);
    EXPECT_EQ(report.warning.find("fx and fy") != std::string::npos, i == 0) << report.warning;
    EXPECT_EQ(report.warning.find("100 s and more apart") != std::string::npos, i == 4);
  }
}

TEST(ForeignViews, TimesThatAreIrregularAreSuspectedFirst) {
  const RenderedCorridor corridor(kSmall, 12);
  for (const bool irregular : {false, true}) {
    System system(kSmall, Settings(), Schedule::kSequential);
    bool told = false;
    for (int i = 0; i < 8; ++i) {
      StereoFrame frame =
          corridor.look(i, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, 0.3 * i)});
      if (irregular && i == 5) frame.timestamp -= 0.095;
      const std::string warning = system.feed(frame).warning;
      told = told || warning.find("time stamps that are wrong or irregular") != std::string::npos;
    }
    EXPECT_EQ(told, irregular);
  }
}

TEST(ForeignViews, ATurnedCameraIsNoSwappedPair) {
  // Pitch and yaw of the right camera: far points lie further right in its image, and on other
  // rows.
  const RenderedCorridor corridor(kSmall, 12);
  const StereoFrame frame = corridor.look(0, Rigid3());
  GrayImage turned(frame.right.width(), frame.right.height());
  for (int y = 0; y < turned.height(); ++y) {
    for (int x = 0; x < turned.width(); ++x) {
      const int from_x = x - 40, from_y = y - 6;
      if (from_x >= 0 && from_y >= 0) turned.at(x, y) = frame.right.at(from_x, from_y);
    }
  }
  const PairCheck check = check_stereo_pair(frame.left, turned);
  EXPECT_GT(check.backward_share, 0.5);
  EXPECT_NE(check.problem.find("not rectified"), std::string::npos) << check.problem;
  const PairCheck swapped = check_stereo_pair(frame.right, frame.left);
  EXPECT_NE(swapped.problem.find("swapped"), std::string::npos) << swapped.problem;
}

}  // namespace
}  // namespace kys_slam
