// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/report.h>

#include <cstdint>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "pair_queue.h"

namespace kys_slam::ros {

/// diagnostic_msgs/DiagnosticStatus, with its numbers.
struct Diagnostics {
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2, kStale = 3 };
  Level level = Level::kOk;
  std::string message;
  std::vector<std::pair<std::string, std::string>> values;
};

/// What the node knows of its state, for the next report. Not thread-safe.
class DiagnosticsLog {
 public:
  void add(const FrameReport& report);
  /// The run starts again; "" or why.
  void restart();

  std::string missing_info;  ///< "left", ..: whose camera_info is missing; "": none
  bool info_changed = false;
  std::string error;                ///< of the last pair, that could not be tracked; "": none
  std::int64_t stray_segments = 0;  ///< label images whose stamp no frame has

  /// The state since the last call.
  Diagnostics take(const PairCounts& counts);

 private:
  [[nodiscard]] double rate() const;
  [[nodiscard]] std::pair<Diagnostics::Level, std::string> state(const PairCounts& counts) const;

  static constexpr std::size_t kRateFrames = 30;
  std::deque<double> stamps_;  // s, of the last frames fed
  FrameReport last_;
  std::int64_t frames_ = 0, lost_ = 0, segmented_ = 0;  // in all
  std::int64_t new_frames_ = 0;                         // since take()
  FrameReport worst_;                                   // since take(), by integrity
  PairCounts before_;                                   // at take()
};

}  // namespace kys_slam::ros
