#pragma once

#include <cstdint>
#include <string>

#include "util/stopwatch.h"

namespace kys_slam {

/// Progress of a long task on stderr: a bar that moves on a terminal, a plain line every few seconds
/// otherwise; nothing in the first two seconds, nothing at all when quiet.
class Progress {
 public:
  /// \param total  steps; 0: not known
  Progress(std::string task, std::int64_t total, bool quiet = false);
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress();

  void advance(std::int64_t steps = 1);

 private:
  void show();

  std::string task_;
  std::int64_t total_;
  std::int64_t done_ = 0;
  bool quiet_;
  bool terminal_;
  bool shown_ = false;
  double next_ms_ = 2000;
  Stopwatch watch_;
};

}  // namespace kys_slam
