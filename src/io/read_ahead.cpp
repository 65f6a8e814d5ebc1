// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/read_ahead.h>

#include <algorithm>
#include <utility>

namespace kys_slam {

ReadAhead::ReadAhead(FrameSource& source, std::size_t depth)
    : source_(source), depth_(std::max<std::size_t>(depth, 1)), thread_([this] { run(); }) {}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void ReadAhead::run() {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stop_ || queue_.size() < depth_; });
      if (stop_) return;
    }
    bool ended = true;
    try {
      std::optional<StereoFrame> frame = source_.next();
      const std::lock_guard lock(mutex_);
      if (frame) queue_.push_back(std::move(*frame));
      ended_ = ended = !frame;
    } catch (...) {
      const std::lock_guard lock(mutex_);
      error_ = std::current_exception();
      ended_ = true;
    }
    changed_.notify_all();
    if (ended) return;
  }
}

std::optional<StereoFrame> ReadAhead::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return ended_ || !queue_.empty(); });
  if (queue_.empty()) {
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
    return std::nullopt;
  }
  StereoFrame frame = std::move(queue_.front());
  queue_.pop_front();
  lock.unlock();
  changed_.notify_all();
  return frame;
}

}  // namespace kys_slam
