// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/process_figures.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace kys_slam {
namespace {

constexpr std::size_t kUnlookedAt = std::size_t{64} << 20;  // bytes
constexpr double kShare = 0.9;                              // the rest is for everybody else
constexpr double kMega = 1e6;

std::string megabytes(double bytes) {
  return std::to_string(std::llround(bytes / kMega)) + " MB";
}

/// The number a file of one number holds; infinity: no such file, or "max".
double number_in(const char* path) {
  std::FILE* file = std::fopen(path, "re");
  if (file == nullptr) return HUGE_VAL;
  double value = 0;
  const int read = std::fscanf(file, "%lf", &value);
  std::fclose(file);
  return read == 1 ? value : HUGE_VAL;
}

double limit_of_the_machine() {
  double least =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (!(least > 0)) least = HUGE_VAL;
  // Of the control group a container sees as its root, version 2 and version 1.
  for (const char* path :
       {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    least = std::min(least, number_in(path));
  }
  rlimit own{};
  if (::getrlimit(RLIMIT_AS, &own) == 0 && own.rlim_cur != RLIM_INFINITY) {
    least = std::min(least, static_cast<double>(own.rlim_cur));
  }
  return kShare * least;
}

double find_limit() {
  const char* text = std::getenv("KYS_MEMORY_MB");
  if (text == nullptr || *text == '\0') return limit_of_the_machine();
  const auto value = parse_double(text);
  if (!value || !(*value > 0)) {
    throw InputError("KYS_MEMORY_MB: '" + std::string(text) + "' is not a positive number");
  }
  return *value * kMega;
}

}  // namespace

std::size_t memory_limit() {
  static const double limit = find_limit();
  constexpr double kMost = 9e18;
  return static_cast<std::size_t>(std::min(limit, kMost));
}

void check_memory(std::string_view name, std::size_t bytes) {
  if (bytes < kUnlookedAt) return;
  const auto limit = static_cast<double>(memory_limit());
  const double in_use = resident_memory_mb() * kMega;
  if (in_use + static_cast<double>(bytes) <= limit) return;
  throw InputError(std::string(name) + ": needs " + megabytes(static_cast<double>(bytes)) +
                   " of memory beside the " + megabytes(in_use) + " in use; the limit is " +
                   megabytes(limit) + " (KYS_MEMORY_MB)");
}

void check_memory_in_use(double resident_mb) {
  const auto limit = static_cast<double>(memory_limit());
  if (resident_mb * kMega <= limit) return;
  throw InputError("out of memory: " + megabytes(resident_mb * kMega) + " in use, the limit is " +
                   megabytes(limit) + " (KYS_MEMORY_MB)");
}

}  // namespace kys_slam
