#pragma once

namespace kys_slam {

/// What this process has used so far.
struct ProcessFigures {
  double resident_mb = 0;       ///< resident memory now, MB (1e6 bytes)
  double peak_resident_mb = 0;  ///< largest resident memory so far, MB
  double user_seconds = 0;      ///< CPU time of all threads
  double system_seconds = 0;

  [[nodiscard]] double cpu_seconds() const { return user_seconds + system_seconds; }
};

/// Takes some 20 us (two files of /proc).
ProcessFigures process_figures();
/// Only the resident memory now, MB; a few microseconds.
double resident_memory_mb();

}  // namespace kys_slam
