// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/pair_watch.h>

#include <cmath>
#include <random>
#include <string>

namespace kys_slam {
namespace {

constexpr int kWidth = 320, kHeight = 160, kDisparity = 12;

/// Squares of all sizes: a wall, wider and higher than the images.
GrayImage make_wall() {
  GrayImage wall(kWidth + 400, kHeight + 100);
  for (int y = 0; y < wall.height(); ++y) {
    for (int x = 0; x < wall.width(); ++x) wall.at(x, y) = 128;
  }
  std::mt19937 random(7);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  for (int i = 0; i < 2500; ++i) {
    const int side = 4 + below(14);
    const int left = below(wall.width() - side), top = below(wall.height() - side);
    const auto value = static_cast<std::uint8_t>(below(256));
    for (int y = top; y < top + side; ++y) {
      for (int x = left; x < left + side; ++x) wall.at(x, y) = value;
    }
  }
  return wall;
}

GrayImage cut(const GrayImage& wall, int left, int top) {
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) image.at(x, y) = wall.at(left + x, top + y);
  }
  return image;
}

enum class Fault { kNone, kLate, kLateAndStill, kSwapped, kRows };

/// A camera that passes a wall on a bumpy road.
class Drive : public FrameSource {
 public:
  Drive(Fault fault, int frames) : fault_(fault), frames_(frames), wall_(make_wall()) {}

  const StereoCamera& camera() const override { return camera_; }
  std::optional<std::int64_t> size() const override { return frames_; }
  std::optional<StereoFrame> next() override {
    if (i_ == frames_) return std::nullopt;
    StereoFrame frame;
    frame.index = i_;
    const int right_at = fault_ == Fault::kLate && i_ > 0 ? i_ - 1 : i_;
    frame.left = cut(wall_, x(i_), y(i_));
    frame.right =
        cut(wall_, x(right_at) + kDisparity, y(right_at) + (fault_ == Fault::kRows ? 3 : 0));
    if (fault_ == Fault::kSwapped) std::swap(frame.left, frame.right);
    ++i_;
    return frame;
  }

 private:
  int x(int i) const { return fault_ == Fault::kLateAndStill ? 50 : 20 + 2 * i; }
  int y(int i) const {
    return fault_ == Fault::kLateAndStill ? 50 : 50 + static_cast<int>(3 * std::sin(1.3 * i));
  }

  Fault fault_;
  int frames_;
  int i_ = 0;
  GrayImage wall_;
  StereoCamera camera_{kWidth, kHeight, 200, 200, 160, 80, 0.5};
};

struct Told {
  std::string warning;
  int times = 0;
  int frames = 0;
};

Told watch(Fault fault, int frames = 30) {
  Drive drive(fault, frames);
  Told told;
  PairWatch watched(drive, [&](const std::string& text) {
    told.warning = text;
    ++told.times;
  });
  while (watched.next()) ++told.frames;
  EXPECT_EQ(told.frames, frames);
  EXPECT_EQ(watched.warning(), told.warning);
  return told;
}

TEST(PairWatch, SaysNothingOfASoundPair) {
  EXPECT_EQ(watch(Fault::kNone, 60).warning, "");
}

TEST(PairWatch, TellsOnceThatTheRightImageIsLate) {
  const Told told = watch(Fault::kLate, 60);
  EXPECT_EQ(told.times, 1);
  EXPECT_NE(told.warning.find("not of the same moment"), std::string::npos) << told.warning;
}

TEST(PairWatch, TellsOfSwappedCamerasAndOfRowsThatDiffer) {
  const Told swapped = watch(Fault::kSwapped), rows = watch(Fault::kRows);
  EXPECT_NE(swapped.warning.find("swapped"), std::string::npos) << swapped.warning;
  EXPECT_NE(rows.warning.find("not rectified"), std::string::npos) << rows.warning;
  EXPECT_NE(rows.warning.find("3.0 px"), std::string::npos) << rows.warning;
  EXPECT_EQ(swapped.times + rows.times, 2);
}

TEST(PairWatch, TellsAtTheEndOfAShortSequence) {
  EXPECT_NE(watch(Fault::kSwapped, 6).warning, "");
  EXPECT_EQ(watch(Fault::kNone, 6).warning, "");
}

TEST(PairWatch, SaysNothingWhileTheCameraStands) {
  EXPECT_EQ(watch(Fault::kLateAndStill).warning, "");
}

}  // namespace
}  // namespace kys_slam
