#include "tracking/picture_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace kys_slam {
namespace {

constexpr double kPeriod = 0.1;

std::vector<double> times_of(const std::vector<double>& stamps) {
  PictureClock clock;
  std::vector<double> times;
  for (const double stamp : stamps) times.push_back(clock.time_of(stamp));
  return times;
}

/// Intervals that are relative to the one before wrong by a factor of 1.5: so is the step by
/// constant velocity.
int wrong_intervals(const std::vector<double>& times, const std::vector<double>& taken,
                    std::size_t from) {
  const auto change = [](const std::vector<double>& at, std::size_t i) {
    return (at[i] - at[i - 1]) / (at[i - 1] - at[i - 2]);
  };
  int wrong = 0;
  for (std::size_t i = from; i < times.size(); ++i) {
    const double ratio = change(times, i) / change(taken, i);
    if (!(ratio > 1 / 1.5 && ratio < 1.5)) ++wrong;
  }
  return wrong;
}

TEST(PictureClock, GoodStampsStayAsTheyAre) {
  std::vector<double> stamps;
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    // 1403636579.76 s: a stamp of today's size. A few milliseconds of jitter; pictures are missing.
    if (i > 3 && random() % 5 == 0) continue;
    stamps.push_back(1403636579.76 + kPeriod * i + 1e-5 * static_cast<double>(random() % 300));
  }
  EXPECT_EQ(times_of(stamps), stamps);
}

TEST(PictureClock, JitterIsTakenOut) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> jitter(-0.2 * kPeriod, 0.2 * kPeriod);
  std::vector<double> taken;
  std::vector<double> stamps;
  for (int i = 0; i < 300; ++i) {
    taken.push_back(kPeriod * i);
    stamps.push_back(taken.back() + jitter(random));
  }
  EXPECT_GT(wrong_intervals(stamps, taken, 30), 20) << "the test needs jitter";
  EXPECT_EQ(wrong_intervals(times_of(stamps), taken, 30), 0);
}

TEST(PictureClock, MissingPicturesCountInJitterToo) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-0.15 * kPeriod, 0.15 * kPeriod);
  std::vector<double> taken;
  std::vector<double> stamps;
  for (int i = 0; i < 300; ++i) {
    if (i > 3 && random() % 6 == 0) continue;
    taken.push_back(kPeriod * i);
    stamps.push_back(taken.back() + jitter(random));
  }
  EXPECT_EQ(wrong_intervals(times_of(stamps), taken, 30), 0);
}

/// A camera that halves its rate in the dark, and doubles it again.
TEST(PictureClock, AnotherRateIsFollowed) {
  std::vector<double> stamps{0};
  for (int i = 0; i < 180; ++i) {
    stamps.push_back(stamps.back() + (i < 60 || i >= 120 ? kPeriod : 2 * kPeriod));
  }
  EXPECT_EQ(times_of(stamps), stamps);
}

/// Pictures taken now and then, such as the keyframes of another recording.
TEST(PictureClock, WithoutARateTheStampsCount) {
  std::mt19937 random(4);
  std::vector<double> stamps{0};
  for (int i = 0; i < 200; ++i) {
    stamps.push_back(stamps.back() + 0.05 + 1e-3 * static_cast<double>(random() % 3000));
  }
  const std::vector<double> times = times_of(stamps);
  int other = 0;
  for (std::size_t i = 0; i < times.size(); ++i) other += times[i] != stamps[i] ? 1 : 0;
  EXPECT_LT(other, 20);
}

TEST(PictureClock, ALongGapBeginsAnew) {
  std::vector<double> stamps;
  for (int i = 0; i < 40; ++i) stamps.push_back(kPeriod * i);
  for (int i = 0; i < 40; ++i) stamps.push_back(1000.03 + kPeriod / 3 * i);
  EXPECT_EQ(times_of(stamps), stamps);
}

}  // namespace
}  // namespace kys_slam
