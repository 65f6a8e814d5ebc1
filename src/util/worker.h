#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

namespace kys_slam {

/// One thread that runs one job at a time: `run_beside` for fork and join, `start` and `wait` for
/// what outlives the caller's block. Joined in its destructor.
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

  /// Runs `job` in the thread and `own` here. Returns or throws when both have ended, so that
  /// both may refer to what the caller has on its stack; of two failures that of `own` is thrown.
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

  /// Hands over a job. The one before has to have been waited for.
  void start(std::function<void()> job) {
    {
      const std::lock_guard lock(mutex_);
      job_ = std::move(job);
      busy_ = true;
    }
    changed_.notify_all();
  }

  /// Returns when the job is done; throws what it threw.
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !busy_; });
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

 private:
  /// Waits, and forgets what the job threw.
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
