// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "priors/fusion/options.h"

namespace kys_slam {

/// A thing segment of the current frame.
struct Detection {
  std::uint16_t label = 0;
  double u = 0;  ///< px, centroid of its mask
  double v = 0;  ///< px
};

/// Checks that so many things and tracks can be assigned to each other: memory grows with the
/// square of their number, time with its third power. \throws InputError for more than 2048, or
/// without memory for them
void check_assignment(std::size_t things, std::size_t tracks);

/// Gives the thing segments of one camera identities over time (Sec. 3.2): assignment with least
/// sum of centroid distances (px). Pairs beyond `max_distance` are rejected. Tracks survive
/// `max_missed_frames` frames without a match. Frames in order.
class InstanceAssociator {
 public:
  explicit InstanceAssociator(const BuilderOptions::Association& options) : options_(options) {}

  /// Identities of the detections, 0, 1, 2, ... in order of first appearance.
  /// \throws InputError as check_assignment() does, of those of one class
  std::vector<std::int32_t> next_frame(std::span<const Detection> detections);

  [[nodiscard]] std::int32_t identities_given() const { return next_identity_; }

 private:
  struct Track {
    std::int32_t identity = 0;
    std::uint16_t label = 0;
    double u = 0;
    double v = 0;
    int missed = 0;
  };
  void assign(std::span<const Detection> detections, const std::vector<std::size_t>& detection_ids,
              const std::vector<std::size_t>& track_ids, std::vector<std::int32_t>& track_of) const;

  BuilderOptions::Association options_;
  std::vector<Track> tracks_;  ///< in order of identity
  std::int32_t next_identity_ = 0;
};

}  // namespace kys_slam
