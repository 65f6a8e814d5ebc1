// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_observation.h>
#include <kys_slam/image.h>
#include <kys_slam/report.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace kys_slam {

/// Writes the observation of every frame to a file descriptor, for another process. The thread that
/// feeds copies the numbers and shares the image. A thread of this object encodes the image as JPEG
/// and writes both. Neither runs Python code.
///
/// A frame is the byte 'F', the length of the rest (u64), the length of a header (u32), the header
/// (JSON), then the arrays, with sizes from the header (kys_slam/record_process.py reads them).
class ObservationPipe {
 public:
  /// \param descriptor  duplicated; the caller keeps its own
  /// \param wait  true: feeding waits when the reader is kCapacity frames behind; false: frames are
  /// skipped. The reader runs at a low priority, so that tracking has precedence.
  /// \param jpeg_quality  of the images, 1 to 100; 0: no images
  ObservationPipe(int descriptor, bool wait, int jpeg_quality);
  ObservationPipe(const ObservationPipe&) = delete;
  ObservationPipe& operator=(const ObservationPipe&) = delete;
  virtual ~ObservationPipe();

  /// \param left  may be empty; must not change afterwards. The writing thread releases it.
  /// \param segments  bytes of the frame's prior file; empty: none
  void put(const FrameObservation& seen, std::shared_ptr<const GrayImage> left,
           std::span<const std::uint8_t> segments);

  /// Returns when all frames are written or none can be written any more.
  void finish();

  [[nodiscard]] bool broken() const;           ///< no frame is written any more
  [[nodiscard]] std::string error() const;     ///< why; "": the reader has closed the pipe
  [[nodiscard]] std::int64_t skipped() const;  ///< frames

  static constexpr std::size_t kCapacity = 16;

 protected:
  /// Ends the writing thread. Frames not written yet are dropped.
  void stop();

 private:
  /// A frame, copied; its image is shared.
  struct Item {
    FrameReport report;
    std::vector<ObservedInstance> instances;
    std::size_t keypoints = 0, priors = 0;  // lengths
    std::vector<std::uint8_t> arrays;       // of keypoints and priors
    std::shared_ptr<const GrayImage> left;
    std::vector<std::uint8_t> segments;
  };
  static void copy(const FrameObservation& seen, std::span<const std::uint8_t> segments,
                   Item& item);
  static std::string head_of(const Item& item, std::size_t jpeg_size);
  void run();
  bool write_item(const Item& item);
  bool write_all(const void* data, std::size_t size) const;

  int descriptor_;
  bool wait_;
  int jpeg_quality_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> queue_;
  std::vector<Item> spare_;  // items whose memory is reused
  std::int64_t skipped_ = 0;
  std::string error_;
  bool writing_ = false;
  bool broken_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace kys_slam
