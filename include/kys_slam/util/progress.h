#pragma once

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>

namespace kys_slam {

/// Shows how far a long task is, on stderr: a bar that redraws itself on a terminal, a plain line
/// now and then otherwise. Nothing is shown for tasks that take less than two seconds, except on a
/// terminal. Used from one thread.
class Progress {
 public:
  /// How to show: by what stderr is, or nothing at all.
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

/// Tells on stderr that something of unknown length is still going on: a line with the time that
/// has passed after two seconds and every five from then on, until it is destroyed.
class Waiting {
 public:
  explicit Waiting(std::string label, Progress::Style style = Progress::Style::kAuto,
                   std::FILE* out = stderr);

 private:
  std::jthread thread_;
};

}  // namespace kys_slam
