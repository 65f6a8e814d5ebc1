// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tracking/pose_candidate.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

// Sources of candidates for the pose of a frame. Each finds matches in its own way and estimates
// the pose from them; none changes anything. All need a last frame with a pose. Which one is asked,
// and what is taken of what they find, is decided by PoseJudge.

/// Searches the landmarks of the last frame where constant velocity expects them. Call it when a
/// pose is expected.
struct MotionSource {
  [[nodiscard]] Attempt find(const TrackingContext& context, const TrackedFrame& frame) const;
};

/// No velocity, or it was wrong: the reference keyframe's landmarks by descriptor alone, starting
/// from the last pose.
struct ReferenceSource {
  /// Every n-th of its landmarks is searched. A part is searched without the prior of the expected
  /// pose: with so few matches that prior would decide the pose.
  std::size_t every = 1;

  [[nodiscard]] Attempt find(const TrackingContext& context, const TrackedFrame& frame) const;
};

/// The same with all landmarks of the map around the last frame.
struct MapSource {
  [[nodiscard]] Attempt find(const TrackingContext& context, const TrackedFrame& frame) const;
};

/// When images are missing and the last frame was no keyframe, too few of its landmarks are seen
/// again, while its other stereo points are still in view. They are looked for where constant
/// velocity expects them; points that are landmarks too become those of the frame. Call it when a
/// pose is expected.
struct PointSource {
  [[nodiscard]] Attempt find(const TrackingContext& context, const TrackedFrame& frame) const;
};

}  // namespace kys_slam
