// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace kys_slam {

/// Resources used by this process so far.
struct ProcessFigures {
  double resident_mb = 0;       ///< resident memory now, MB (1e6 bytes)
  double peak_resident_mb = 0;  ///< largest resident memory so far, MB
  double user_seconds = 0;      ///< CPU time of all threads
  double system_seconds = 0;

  [[nodiscard]] double cpu_seconds() const { return user_seconds + system_seconds; }
};

/// Reads two files of /proc; takes about 20 us.
ProcessFigures process_figures();
/// Resident memory now, MB. Takes a few us.
double resident_memory_mb();

}  // namespace kys_slam
