// SPDX-License-Identifier: BSD-3-Clause
#include "system/segment_queue.h"

#include <fmt/format.h>
#include <kys_slam/error.h>

#include <chrono>
#include <utility>

namespace kys_slam {

void SegmentQueue::put(std::int64_t frame, std::shared_ptr<const SegmentImage> image) {
  {
    const std::lock_guard lock(mutex_);
    if (too_late_ || ended_) return;
    if (frame < 0) throw InputError(fmt::format("segments of frame {}: no such frame", frame));
    if (!delivered_.insert(frame).second) {
      throw InputError(fmt::format("segments of frame {} are given twice", frame));
    }
    if (waiting_.size() >= kMostWaiting) {
      throw InputError(fmt::format("segments of frame {}: those of {} frames wait already", frame,
                                   kMostWaiting));
    }
    if (delivered_.size() > 2 * kMostWaiting) delivered_.erase(delivered_.begin());
    used_ = true;
    waiting_.emplace(frame, std::move(image));
  }
  changed_.notify_all();
}

void SegmentQueue::end() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  changed_.notify_all();
}

std::vector<SegmentQueue::Delivery> SegmentQueue::take(std::int64_t now) {
  std::unique_lock lock(mutex_);
  const std::int64_t due = realtime_ ? now : now - options_.lag;
  if (!realtime_ && !too_late_ && options_.every > 0 && due >= 0 && due % options_.every == 0) {
    const bool there = changed_.wait_for(lock, std::chrono::duration<double>(options_.timeout),
                                         [&] { return ended_ || delivered_.contains(due); });
    if (!there) {
      too_late_ = true;
      waiting_.clear();
      warning_ = fmt::format(
          "no segments of frame {} within {:g} s (control.segment_timeout): the "
          "run goes on without any",
          due, options_.timeout);
    }
  }
  std::vector<Delivery> taken;
  while (!waiting_.empty() && waiting_.begin()->first <= due) {
    auto node = waiting_.extract(waiting_.begin());
    if (node.mapped() != nullptr) taken.push_back({node.key(), std::move(node.mapped())});
  }
  return taken;
}

bool SegmentQueue::in_use() {
  const std::lock_guard lock(mutex_);
  return used_ || options_.every > 0;
}

bool SegmentQueue::over() {
  const std::lock_guard lock(mutex_);
  return (ended_ && waiting_.empty()) || too_late_;
}

std::string SegmentQueue::take_warning() {
  const std::lock_guard lock(mutex_);
  return std::exchange(warning_, "");
}

}  // namespace kys_slam
