// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "map/keyframe_message.h"
#include "map/landmark_id_allocator.h"
#include "tracking/landmark_patches.h"
#include "tracking/tracking_context.h"
#include "tracking/visibility_counts.h"

namespace kys_slam {

/// Decides whether a frame becomes a keyframe, and makes what it gives to the map. Owns the ids of
/// new keyframes and landmarks, and counts how often landmarks were found.
class KeyFrameMaker {
 public:
  /// Continues a loaded map: new ids begin at the given ones. With `frozen` there are no keyframes.
  void continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end, bool frozen);
  [[nodiscard]] bool frozen() const { return frozen_; }

  /// First keyframe of the sub-map being tracked, or the one at which tracking resumed.
  [[nodiscard]] KeyFrameId first() const { return first_; }
  void set_first(KeyFrameId first) { first_ = first; }

  /// The keyframe that the frame of this index became; invalid: none, or not the last one.
  [[nodiscard]] KeyFrameId keyframe_of(std::int64_t index) const {
    return index == last_frame_ ? last_ : KeyFrameId{};
  }

  /// Landmarks that should be in view, and of these those that were found.
  void count(const std::vector<LandmarkId>& visible, const std::vector<LandmarkId>& found);
  /// \param waiting keyframes sent to the back end whose change set has not been applied
  [[nodiscard]] bool is_due(const TrackingContext& context, const TrackedFrame& frame, int inliers,
                            int waiting) const;
  /// Makes the frame a keyframe: the replica and the patches have it at once, the back end gets the
  /// message. The frame's new landmarks become its own; the keyframe is the next reference.
  KeyFrameMessage make(const TrackingContext& context, TrackedFrame& frame, Replica& replica,
                       LandmarkPatches& patches);

 private:
  [[nodiscard]] KeyFrameSituation situation(const TrackingContext& context,
                                            const TrackedFrame& frame, int inliers,
                                            int waiting) const;
  [[nodiscard]] std::optional<ExpectedMotion> expected_motion(const TrackingContext& context,
                                                              const TrackedFrame& frame) const;
  void add_stereo_landmarks(const TrackingContext& context, const TrackedFrame& frame,
                            Replica& replica, KeyFrameMessage& message);

  std::uint32_t next_ = 0;
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kTracker};
  bool frozen_ = false;
  KeyFrameId first_;
  KeyFrameId last_;
  std::int64_t last_frame_ = 0;  // index of the frame that became the last keyframe
  VisibilityCounts counts_;      // since the last keyframe
};

}  // namespace kys_slam
