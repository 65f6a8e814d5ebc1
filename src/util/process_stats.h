#pragma once

namespace kys_slam {

/// Resident memory of this process now, MB; 0 where the system does not tell.
double resident_memory_mb();
/// The most it ever was, MB.
double peak_memory_mb();
/// Processor time of this process so far, user and system, s.
double cpu_seconds();

}  // namespace kys_slam
