// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

namespace kys_slam {

/// When a camera takes its images: at a constant rate, whatever the jitter of its time stamps.
/// Software gives an image its stamp when it arrives, tens of milliseconds late. The line through
/// the last stamps over the numbers of their images (least squares) gives the rate, and the
/// number of a new image: missing ones count. Without a constant rate the stamps count.
class ImageClock {
 public:
  /// Time (s) at which the image with the stamp `stamp` (s) was taken: the stamp itself when it
  /// is within kTolerance of the line, else the time on the line. Stamps increase; the last one may
  /// be asked for again.
  double time_of(double stamp) {
    if (stamps_.empty() || stamp > stamps_.back().time) add(stamp);
    period_ = 0;
    if (stamps_.size() == 1) return stamp;
    const Line now = line();
    if (deviation(now) > kRegular * now.period) return stamp;
    period_ = now.period;
    const double expected = now.at(stamps_.back().number);
    return std::abs(stamp - expected) <= kTolerance * now.period ? stamp : expected;
  }

  /// How many steps of the camera an interval (s) between two images is: a whole number, at least
  /// 1. Nothing without a constant rate.
  [[nodiscard]] std::optional<double> steps_in(double interval) const {
    if (period_ <= 0) return std::nullopt;
    return std::max(1.0, std::round(interval / period_));
  }

  /// How many times as long as a step of `before` (s) one of `interval` (s) is. The jitter of time
  /// stamps is larger than real changes of the velocity: steps have other lengths only where
  /// images are missing.
  [[nodiscard]] double ratio(double interval, double before) const {
    if (const auto steps = steps_in(interval)) return *steps / *steps_in(before);
    const double times = interval / before;
    return times < kMissing && times > 1 / kMissing ? 1 : times;
  }

 private:
  static constexpr std::size_t kWindow = 24;  // images
  static constexpr double kLongestGap = 24;   // images
  static constexpr double kTolerance = 0.1;   // periods
  // Periods; a larger deviation from the line is that of a camera without a constant rate. Times
  // that have nothing to do with the line deviate by 0.29 periods from the nearest number.
  static constexpr double kRegular = 0.2;
  // A step that takes this many times as long as another, of a camera without a constant rate: a
  // image is missing.
  static constexpr double kMissing = 1.5;

  struct Stamp {
    double number = 0;  // of the image
    double time = 0;    // s
  };
  struct Line {
    Stamp mean;
    double period = 0;  // s
    [[nodiscard]] double at(double number) const {
      return mean.time + period * (number - mean.number);
    }
  };

  void add(double stamp) {
    if (stamps_.size() < kWindow) {
      stamps_.push_back({0, stamp});
      number_all();
      return;
    }
    const Line before = line();
    const double steps = std::round((stamp - before.at(stamps_.back().number)) / before.period);
    if (steps > kLongestGap) {
      stamps_.assign(1, {0, stamp});
      return;
    }
    stamps_.push_back({stamps_.back().number + std::max(1.0, steps), stamp});
    stamps_.pop_front();
  }

  /// At the start: numbers by the mean interval without those in which images are missing.
  void number_all() {
    if (stamps_.size() == 1) return;
    std::vector<double> intervals;
    for (std::size_t i = 1; i < stamps_.size(); ++i) {
      intervals.push_back(stamps_[i].time - stamps_[i - 1].time);
    }
    const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() - 1) / 2;
    std::nth_element(intervals.begin(), middle, intervals.end());
    const double bound = 1.5 * *middle;
    double sum = 0;
    double count = 0;
    for (const double interval : intervals) {
      if (interval >= bound) continue;
      sum += interval;
      ++count;
    }
    const double period = sum / count;
    double offsets = 0;  // sum of what stamps are later than the first plus their number of periods
    for (std::size_t i = 1; i < stamps_.size(); ++i) {
      const double start = stamps_.front().time + offsets / static_cast<double>(i);
      const double steps = (stamps_[i].time - start) / period - stamps_[i - 1].number;
      stamps_[i].number = stamps_[i - 1].number + std::max(1.0, std::round(steps));
      offsets += stamps_[i].time - stamps_.front().time - period * stamps_[i].number;
    }
  }

  [[nodiscard]] Line line() const {
    Line line;
    const auto count = static_cast<double>(stamps_.size());
    for (const Stamp& s : stamps_) {
      line.mean.number += s.number / count;
      line.mean.time += (s.time - stamps_.front().time) / count;
    }
    line.mean.time += stamps_.front().time;
    double products = 0;
    double squares = 0;
    for (const Stamp& s : stamps_) {
      products += (s.number - line.mean.number) * (s.time - line.mean.time);
      squares += (s.number - line.mean.number) * (s.number - line.mean.number);
    }
    line.period = products / squares;
    return line;
  }

  /// Of the stamps from the line, s, root mean square.
  [[nodiscard]] double deviation(const Line& line) const {
    double sum = 0;
    for (const Stamp& s : stamps_) {
      const double off = s.time - line.at(s.number);
      sum += off * off;
    }
    return std::sqrt(sum / static_cast<double>(stamps_.size()));
  }

  std::deque<Stamp> stamps_;
  double period_ = 0;  // s, with the last stamp; 0: no constant rate
};

}  // namespace kys_slam
