// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/image_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace kys_slam {
namespace {

constexpr double kPeriod = 0.1;

std::vector<double> times_of(const std::vector<double>& stamps) {
  ImageClock clock;
  std::vector<double> times;
  for (const double stamp : stamps) times.push_back(clock.time_of(stamp));
  return times;
}

struct Recording {
  std::vector<double> taken;   ///< s
  std::vector<double> stamps;  ///< s
};

/// Stamps that are wrong by up to `jitter` periods, and one image in `missing_in` is missing (0:
/// none).
Recording record(double jitter, unsigned missing_in, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> error(-jitter * kPeriod, jitter * kPeriod);
  Recording recording;
  for (int i = 0; i < 300; ++i) {
    if (missing_in > 0 && i > 3 && random() % missing_in == 0) continue;
    recording.taken.push_back(kPeriod * i);
    recording.stamps.push_back(recording.taken.back() + error(random));
  }
  return recording;
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

TEST(ImageClock, GoodStampsStayAsTheyAre) {
  std::vector<double> stamps;
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    // 1403636579.76 s: a stamp of today's size. A few milliseconds of jitter; images are missing.
    if (i > 3 && random() % 5 == 0) continue;
    stamps.push_back(1403636579.76 + kPeriod * i + 1e-5 * static_cast<double>(random() % 300));
  }
  EXPECT_EQ(times_of(stamps), stamps);
}

TEST(ImageClock, JitterIsTakenOut) {
  const Recording recording = record(0.2, 0, 2);
  EXPECT_GT(wrong_intervals(recording.stamps, recording.taken, 30), 20) << "the test needs jitter";
  EXPECT_EQ(wrong_intervals(times_of(recording.stamps), recording.taken, 30), 0);
}

TEST(ImageClock, MissingImagesCountInJitterToo) {
  const Recording recording = record(0.15, 6, 3);
  EXPECT_EQ(wrong_intervals(times_of(recording.stamps), recording.taken, 30), 0);
}

TEST(ImageClock, IntervalsAreWholeSteps) {
  const Recording recording = record(0.15, 4, 5);
  ImageClock clock;
  double last = clock.time_of(recording.stamps[0]);
  EXPECT_FALSE(clock.steps_in(kPeriod));
  for (std::size_t i = 1; i < recording.stamps.size(); ++i) {
    const double time = clock.time_of(recording.stamps[i]);
    if (i >= 30) {
      const double steps = (recording.taken[i] - recording.taken[i - 1]) / kPeriod;
      EXPECT_EQ(clock.steps_in(time - last), std::round(steps)) << i;
    }
    last = time;
  }
  EXPECT_EQ(clock.steps_in(0.1 * kPeriod), 1);
}

/// Of one to four images; an error of 0.2 periods changes no ratio.
TEST(ImageClock, StepsOfMoreImagesAreLonger) {
  ImageClock clock;
  for (int i = 0; i < 30; ++i) clock.time_of(kPeriod * i + 0.01 * (i % 2));
  for (const double before : {1, 2, 3, 4}) {
    for (const double now : {1, 2, 3, 4}) {
      EXPECT_DOUBLE_EQ(clock.ratio((now + 0.2) * kPeriod, (before - 0.2) * kPeriod), now / before);
      EXPECT_DOUBLE_EQ(clock.ratio((now - 0.2) * kPeriod, (before + 0.2) * kPeriod), now / before);
    }
  }
}

TEST(ImageClock, WithoutARateStepsAreAsLongAsTheirTime) {
  const ImageClock clock;
  EXPECT_EQ(clock.ratio(0.14, 0.1), 1);
  EXPECT_EQ(clock.ratio(0.07, 0.1), 1);
  EXPECT_DOUBLE_EQ(clock.ratio(0.16, 0.1), 1.6);
  EXPECT_DOUBLE_EQ(clock.ratio(0.06, 0.1), 0.6);
}

TEST(ImageClock, TheLastStampCanBeAskedForAgain) {
  ImageClock once;
  ImageClock twice;
  for (const double stamp : record(0.2, 6, 4).stamps) {
    const double time = once.time_of(stamp);
    EXPECT_EQ(twice.time_of(stamp), time);
    EXPECT_EQ(twice.time_of(stamp), time);
  }
}

/// A camera that halves its rate in the dark, and doubles it again.
TEST(ImageClock, AnotherRateIsFollowed) {
  std::vector<double> stamps{0};
  for (int i = 0; i < 180; ++i) {
    stamps.push_back(stamps.back() + (i < 60 || i >= 120 ? kPeriod : 2 * kPeriod));
  }
  EXPECT_EQ(times_of(stamps), stamps);
}

/// Pictures taken now and then, such as the keyframes of another recording.
TEST(ImageClock, WithoutARateTheStampsCount) {
  std::mt19937 random(4);
  std::vector<double> stamps{0};
  for (int i = 0; i < 200; ++i) {
    stamps.push_back(stamps.back() + 0.05 + 1e-3 * static_cast<double>(random() % 3000));
  }
  const std::vector<double> times = times_of(stamps);
  int other = 0;
  for (std::size_t i = 0; i < times.size(); ++i) other += times[i] != stamps[i] ? 1 : 0;
  EXPECT_LT(other, 20);
  ImageClock clock;
  int regular = 0;
  for (const double stamp : stamps) {
    clock.time_of(stamp);
    regular += clock.steps_in(1) ? 1 : 0;
  }
  EXPECT_LT(regular, 60);
}

TEST(ImageClock, ALongGapBeginsAnew) {
  std::vector<double> stamps;
  for (int i = 0; i < 40; ++i) stamps.push_back(kPeriod * i);
  for (int i = 0; i < 40; ++i) stamps.push_back(1000.03 + kPeriod / 3 * i);
  EXPECT_EQ(times_of(stamps), stamps);
}

}  // namespace
}  // namespace kys_slam
