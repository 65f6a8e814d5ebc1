// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>

namespace kys_slam {

/// Shows the progress of a long task on stderr: a bar on a terminal, plain lines otherwise. Without
/// a terminal, tasks of less than 2 s print nothing. For one thread.
class Progress {
 public:
  /// kAuto: kBar on a terminal, kLines otherwise.
  enum class Style { kAuto, kBar, kLines, kNone };

  /// \param label  what is being done, e.g. "frames"
  /// \param total  number of steps, when known
  Progress(std::string label, std::optional<std::int64_t> total, Style style = Style::kAuto,
           std::FILE* out = stderr);
  /// Ends the bar's line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `done` steps are finished; `note` (short) follows the figures. Cheap to call at every step.
  void update(std::int64_t done, const std::string& note = "");

 private:
  using Clock = std::chrono::steady_clock;

  [[nodiscard]] std::string figures(double elapsed) const;
  void draw_bar(double elapsed, const std::string& note);

  std::string label_;
  std::optional<std::int64_t> total_;
  Style style_;
  std::FILE* out_;
  Clock::time_point begin_;
  Clock::time_point shown_;
  std::int64_t done_ = 0;
  std::size_t bar_length_ = 0;
};

/// Shows on stderr that a task of unknown length is running: a line with the elapsed time after 2 s
/// and every 5 s from then on, until it is destroyed.
class Waiting {
 public:
  explicit Waiting(std::string label, Progress::Style style = Progress::Style::kAuto,
                   std::FILE* out = stderr);

 private:
  std::jthread thread_;
};

}  // namespace kys_slam
