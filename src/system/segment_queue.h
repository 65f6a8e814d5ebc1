// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/segment_image.h>
#include <kys_slam/system.h>

#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "system/segment_options.h"

namespace kys_slam {

/// Segmentations between the thread that makes them and the one that feeds frames. They are taken
/// by the frame at which they take effect: exactly `lag` frames after their own, or in the schedule
/// `realtime` when they are there.
class SegmentQueue {
 public:
  struct Delivery {
    std::int64_t frame = 0;
    std::shared_ptr<const SegmentImage> image;
  };

  SegmentQueue(const SegmentOptions& options, Schedule schedule)
      : options_(options), realtime_(schedule == Schedule::kRealtime) {}

  /// From any thread. \param image null: this frame has none
  /// \throws InputError for a frame that has been delivered or for too many that wait
  void put(std::int64_t frame, std::shared_ptr<const SegmentImage> image);
  /// No more will come. From any thread.
  void end();
  /// What takes effect at frame `now`, by frame; waits where it is due and not there. After a wait
  /// that was too long nothing is taken any more.
  [[nodiscard]] std::vector<Delivery> take(std::int64_t now);
  /// Whether no more will come.
  [[nodiscard]] bool over();
  /// Whether a segmentation came or is expected.
  [[nodiscard]] bool in_use();
  /// A warning of the wait, once; "": none.
  [[nodiscard]] std::string take_warning();

 private:
  static constexpr std::size_t kMostWaiting = 256;

  SegmentOptions options_;
  bool realtime_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::int64_t, std::shared_ptr<const SegmentImage>> waiting_;
  std::set<std::int64_t> delivered_;  // of the last frames
  bool used_ = false;
  bool ended_ = false;
  bool too_late_ = false;
  std::string warning_;
};

}  // namespace kys_slam
