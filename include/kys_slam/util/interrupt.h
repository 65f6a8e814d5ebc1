#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace kys_slam {

/// A wait that can be cut short from another thread, for good.
class InterruptibleWait {
 public:
  /// Returns after `duration` or when `interrupt` has been called.
  void wait_for(std::chrono::duration<double> duration);
  void interrupt();

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool interrupted_ = false;
};

/// While it lives, SIGINT (Ctrl-C), SIGTERM and SIGHUP (the terminal is gone) do not end the
/// program: they are noted, and `on_interrupt` is called once, from a thread of this object, so
/// that it may do anything. A second Ctrl-C or SIGTERM ends the program at once. A signal that the
/// parent had ignored (nohup) stays so. One at a time in a process.
class InterruptGuard {
 public:
  explicit InterruptGuard(std::function<void()> on_interrupt);
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;
  ~InterruptGuard();

  [[nodiscard]] bool requested() const { return requested_; }
  /// Sleeps, but not beyond a signal.
  void wait_for(std::chrono::duration<double> duration) { pause_.wait_for(duration); }

 private:
  void wait();

  std::function<void()> on_interrupt_;
  std::atomic<bool> requested_{false};
  InterruptibleWait pause_;
  std::thread thread_;
};

}  // namespace kys_slam
