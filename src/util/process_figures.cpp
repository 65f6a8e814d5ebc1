// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/process_figures.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>

namespace kys_slam {
namespace {

double seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

/// VmHWM rather than ru_maxrss, which a process inherits from the one that started it.
double peak_resident_mb() {
  std::FILE* file = std::fopen("/proc/self/status", "re");
  if (file == nullptr) return 0;
  char line[256];
  double kilobytes = 0;
  while (std::fgets(line, sizeof line, file) != nullptr) {
    if (std::sscanf(line, "VmHWM: %lf", &kilobytes) == 1) break;
  }
  std::fclose(file);
  return kilobytes * 1024e-6;
}

}  // namespace

double resident_memory_mb() {
  std::FILE* file = std::fopen("/proc/self/statm", "re");
  if (file == nullptr) return 0;
  long total = 0, resident = 0;
  const int read = std::fscanf(file, "%ld %ld", &total, &resident);
  std::fclose(file);
  static const long page_bytes = ::sysconf(_SC_PAGESIZE);
  return read == 2 ? static_cast<double>(resident) * static_cast<double>(page_bytes) * 1e-6 : 0;
}

ProcessFigures process_figures() {
  ProcessFigures figures;
  figures.resident_mb = resident_memory_mb();
  figures.peak_resident_mb = peak_resident_mb();
  rusage usage{};
  if (::getrusage(RUSAGE_SELF, &usage) == 0) {
    figures.user_seconds = seconds(usage.ru_utime);
    figures.system_seconds = seconds(usage.ru_stime);
  }
  return figures;
}

}  // namespace kys_slam
