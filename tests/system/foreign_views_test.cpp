#include <gtest/gtest.h>
#include <kys_slam/error.h>
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

}  // namespace
}  // namespace kys_slam
