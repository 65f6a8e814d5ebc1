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

/// What the system sees, frame by frame, written to a file descriptor for another process: the
/// thread that feeds copies numbers into a buffer and shares the image, a thread of its own makes
/// the image a JPEG and writes both. Python takes no part in either.
///
/// A frame is the byte 'F', the length of the rest (u64), the length of a header (u32), the header
/// (JSON), then the arrays whose sizes the header tells (kys_slam/record_process.py reads them).
class ObservationPipe {
 public:
  /// \param descriptor  duplicated; the caller keeps its own
  /// \param wait  whether feeding waits when the reader is kCapacity frames behind; false: frames
  ///   are skipped then. Who is waited for works at a low priority: tracking goes first.
  /// \param jpeg_quality  of the images, 1 to 100; 0: no images
  ObservationPipe(int descriptor, bool wait, int jpeg_quality);
  ObservationPipe(const ObservationPipe&) = delete;
  ObservationPipe& operator=(const ObservationPipe&) = delete;
  virtual ~ObservationPipe();

  /// \param left  may be empty; must not change any more. The writing thread lets go of it.
  /// \param segments  bytes of the prior file that came with the frame; empty: none
  void put(const FrameObservation& seen, std::shared_ptr<const GrayImage> left,
           std::span<const std::uint8_t> segments);

  /// Returns when all frames are written, or the reader is gone.
  void finish();

  [[nodiscard]] bool broken() const;           ///< the reader is gone
  [[nodiscard]] std::int64_t skipped() const;  ///< frames

  static constexpr std::size_t kCapacity = 16;

 protected:
  /// Ends the writing thread. What is not written yet is not written any more.
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
  bool write_item(const Item& item) const;
  bool write_all(const void* data, std::size_t size) const;

  int descriptor_;
  bool wait_;
  int jpeg_quality_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> queue_;
  std::vector<Item> spare_;  // their memory is used again
  std::int64_t skipped_ = 0;
  bool writing_ = false;
  bool broken_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace kys_slam
