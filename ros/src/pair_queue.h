// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "messages.h"

namespace kys_slam::ros {

/// Counts of images that were not tracked.
struct PairCounts {
  std::int64_t paired = 0;
  std::int64_t dropped = 0;       ///< pairs: tracking is slower than the camera
  std::int64_t unmatched = 0;     ///< images without a partner
  std::int64_t out_of_order = 0;  ///< images whose stamp does not follow the one before
};

/// Joins left and right images by their stamps. Images of a side come in order. Both the images
/// that wait for a partner and the pairs that wait to be tracked are bounded; the oldest go first.
class PairQueue {
 public:
  struct Pair {
    ImageMessage left, right;
  };
  enum class Arrival : std::uint8_t { kTaken, kOutOfOrder, kTimeJump };

  /// \param tolerance s, largest difference of the stamps of a pair
  /// \param size most images of a side and most pairs that wait, at least 1
  /// \param jump s, that a stamp is before the last one of its side where a recording starts again
  PairQueue(double tolerance, std::size_t size, double jump);

  /// After kTimeJump all that waited is gone, and the image is the first one.
  Arrival add(Side side, ImageMessage message);
  /// The oldest pair.
  [[nodiscard]] std::optional<Pair> take();
  [[nodiscard]] bool empty() const { return pairs_.empty(); }
  [[nodiscard]] const PairCounts& counts() const { return counts_; }
  /// Forgets images, pairs and stamps, not the counts.
  void clear();

 private:
  void match();

  std::int64_t tolerance_;  // ns
  std::size_t size_;
  std::int64_t jump_;  // ns
  std::array<std::deque<ImageMessage>, 2> waiting_;
  std::array<std::optional<std::int64_t>, 2> last_;  // ns, stamp
  std::deque<Pair> pairs_;
  PairCounts counts_;
};

}  // namespace kys_slam::ros
