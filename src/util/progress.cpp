#include "util/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace kys_slam {

Progress::Progress(std::string task, std::int64_t total, bool quiet)
    : task_(std::move(task)), total_(total), quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
  if (terminal_ && shown_) std::fputc('\n', stderr);
}

void Progress::advance(std::int64_t steps) {
  done_ += steps;
  if (quiet_ || watch_.elapsed_ms() < next_ms_) return;
  show();
  next_ms_ = watch_.elapsed_ms() + (terminal_ ? 100 : 5000);
}

void Progress::show() {
  shown_ = true;
  const double per_second = 1000 * static_cast<double>(done_) / watch_.elapsed_ms();
  if (total_ <= 0) {
    std::fprintf(stderr, "%s%s %lld, %.1f/s%s", terminal_ ? "\r" : "", task_.c_str(),
                 static_cast<long long>(done_), per_second, terminal_ ? "  " : "\n");
    return;
  }
  const double share = std::clamp(static_cast<double>(done_) / static_cast<double>(total_), 0., 1.);
  std::string bar;
  if (terminal_) {
    constexpr int kWidth = 30;
    const int full = static_cast<int>(share * kWidth);
    bar = " [" + std::string(static_cast<std::size_t>(full), '#') +
          std::string(static_cast<std::size_t>(kWidth - full), ' ') + "]";
  }
  std::fprintf(stderr, "%s%s%s %lld/%lld, %.1f/s%s", terminal_ ? "\r" : "", task_.c_str(),
               bar.c_str(), static_cast<long long>(done_), static_cast<long long>(total_),
               per_second, terminal_ ? "  " : "\n");
}

}  // namespace kys_slam
