// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

namespace kys_slam {

/// One thread that runs one job at a time: `run_beside` for fork and join, `start` and `wait` for
/// jobs that outlive the caller's scope. The destructor joins the thread.
class Worker {
 public:
  Worker() : thread_([this] { run(); }) {}
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  /// Runs `job` in the thread and `own` in the caller. Returns or throws when both have ended, so
  /// that both may refer to local variables of the caller. When both throw, the exception of `own`
  /// is thrown.
  template <typename Own>
  void run_beside(std::function<void()> job, Own&& own) {
    start(std::move(job));
    try {
      own();
    } catch (...) {
      finish_job();
      throw;
    }
    wait();
  }

  /// Starts a job. Call wait() for the job before it first.
  void start(std::function<void()> job) {
    {
      const std::lock_guard lock(mutex_);
      job_ = std::move(job);
      busy_ = true;
    }
    changed_.notify_all();
  }

  /// Returns when the job is done. Throws the exception of the job.
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !busy_; });
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

 private:
  /// Waits and drops the exception of the job.
  void finish_job() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !busy_; });
    failure_ = nullptr;
  }

  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [&] { return stop_ || job_; });
      if (!job_) return;
      const std::function<void()> job = std::exchange(job_, nullptr);
      lock.unlock();
      std::exception_ptr failure;
      try {
        job();
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      failure_ = failure;
      busy_ = false;
      changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::function<void()> job_;
  std::exception_ptr failure_;
  bool busy_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace kys_slam
