// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace kys_slam {

/// A wait that another thread can interrupt. Once interrupted, every later wait returns at once.
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

/// During its lifetime SIGINT (Ctrl-C), SIGTERM and SIGHUP (terminal closed) do not end the
/// program. They set requested(), and `on_interrupt` is called once from a thread of this object,
/// not from a signal handler. A second Ctrl-C or SIGTERM ends the program at once. A signal that
/// the parent process ignores (nohup) stays ignored. At most one object per process.
class InterruptGuard {
 public:
  explicit InterruptGuard(std::function<void()> on_interrupt);
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;
  ~InterruptGuard();

  [[nodiscard]] bool requested() const { return requested_; }
  /// Sleeps for `duration` or until a signal arrives.
  void wait_for(std::chrono::duration<double> duration) { pause_.wait_for(duration); }

 private:
  void wait();

  std::function<void()> on_interrupt_;
  std::atomic<bool> requested_{false};
  InterruptibleWait pause_;
  std::thread thread_;
};

}  // namespace kys_slam
