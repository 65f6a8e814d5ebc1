// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

namespace kys_slam {

/// Reads the frames of another source in its own thread, a few frames ahead of the caller. So
/// decoding does not delay tracking. Frames keep the order of the source. When the source throws,
/// next() throws the same exception in place of that frame, and the stream ends.
class ReadAhead : public FrameSource {
 public:
  /// \param source  must outlive this object; only this object may read it
  /// \param depth   largest number of frames held ready, at least 1
  explicit ReadAhead(FrameSource& source, std::size_t depth = 4);
  /// Joins the thread. Frames that were not taken are dropped.
  ~ReadAhead() override;

  [[nodiscard]] const StereoCamera& camera() const override { return source_.camera(); }
  [[nodiscard]] std::optional<std::int64_t> size() const override { return source_.size(); }
  std::optional<StereoFrame> next() override;

 private:
  void run();

  FrameSource& source_;
  const std::size_t depth_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<StereoFrame> queue_;  // guarded by mutex_
  std::exception_ptr error_;       // guarded by mutex_; comes after the queue
  bool ended_ = false;             // guarded by mutex_; nothing more will be queued
  bool stop_ = false;              // guarded by mutex_
  std::thread thread_;
};

}  // namespace kys_slam
