// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>
#include <kys_slam/report.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "tracking/other_motion.h"
#include "tracking/pose_candidate.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// What is said about the reliability of a pose.
struct IntegrityResult {
  Integrity integrity = Integrity::kOk;
  IntegrityReason reason = IntegrityReason::kNone;
  /// A part of the image keeps its place while the camera moves.
  bool keeps_place = false;
};

/// Judges an accepted pose by what the frame shows. It changes no pose: it reports.
class IntegrityCheck {
 public:
  /// \param frame with its pose and the inliers of it
  /// \param jumped a pose needed an impossible acceleration
  /// \param follows the last frame of the context is the one before, in the same world
  IntegrityResult check(const TrackingContext& context, const TrackedFrame& frame,
                        const Evidence& evidence, bool jumped, bool follows,
                        kys::Statistics& statistics);

 private:
  void remember_still(const TrackingContext& context, const OtherMotion& other);
  std::size_t remember_passing(const TrackingContext& context, const TrackedFrame& frame,
                               kys::Statistics& statistics);
  [[nodiscard]] bool has_still() const;

  std::deque<std::vector<std::size_t>> passing_;  // of the last frames, the cells that flow by
  // Per cell of the image: frames, less those without it, in which something kept its place there.
  std::vector<int> still_;
  std::vector<std::uint8_t> known_;  // 1: reported, takes no part any more
};

}  // namespace kys_slam
