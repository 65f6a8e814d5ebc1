#pragma once

#include <atomic>
#include <functional>
#include <thread>

namespace kys_slam {

/// While it lives, Ctrl-C and SIGTERM do not end the program: they are noted, and `on_interrupt` is
/// called once, from a thread of this object, so that it may do anything. A second signal ends the
/// program at once. One at a time in a process.
class InterruptGuard {
 public:
  explicit InterruptGuard(std::function<void()> on_interrupt);
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;
  ~InterruptGuard();

  [[nodiscard]] bool requested() const { return requested_; }

 private:
  void wait();

  std::function<void()> on_interrupt_;
  std::atomic<bool> requested_{false};
  std::thread thread_;
};

}  // namespace kys_slam
