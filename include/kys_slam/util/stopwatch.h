// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

namespace kys_slam {

/// Wall-clock time since construction or since the last lap.
class Stopwatch {
 public:
  /// ms since the start or the last lap; starts the next one.
  double lap_ms() {
    const Clock::time_point now = Clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }
  [[nodiscard]] double elapsed_ms() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

}  // namespace kys_slam
