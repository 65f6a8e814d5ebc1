#pragma once

#include <kys_slam/frame_source.h>

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

namespace kys_slam {

/// Reads the frames of another source in a thread of its own, a few ahead of the caller, so that
/// decoding does not sit on the tracking path. Frames come in the source's order; an exception of
/// the source is thrown by next() at the place of the frame it belongs to, after which the stream
/// has ended.
class ReadAhead : public FrameSource {
 public:
  /// \param source  must outlive this object and not be read by anyone else
  /// \param depth   frames held ready at most, at least 1
  explicit ReadAhead(FrameSource& source, std::size_t depth = 4);
  /// Joins the thread; frames not taken are dropped.
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
