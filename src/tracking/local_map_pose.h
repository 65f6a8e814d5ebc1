// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "tracking/landmark_patches.h"
#include "tracking/pose_candidate.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// A candidate after the search of the local map.
struct LocalMapPose {
  PoseCandidate candidate;
  std::shared_ptr<const FrameFeatures> features;  ///< of the frame, keypoints aligned
  KeyFrameId reference;             ///< keyframe that shares most with the frame; invalid: none
  std::vector<LandmarkId> visible;  ///< landmarks that should be in view
  std::vector<LandmarkId> found;    ///< of these, those that are inliers
  kys::Statistics statistics;
};

/// Searches the landmarks of the local map that should be in view from the candidate's pose and
/// that it has not matched, aligns keypoints with the patches of their landmarks, and estimates the
/// pose from all (ORB-SLAM, Sec. V-D).
LocalMapPose refine_with_local_map(const TrackingContext& context, const TrackedFrame& frame,
                                   PoseCandidate candidate, const LandmarkPatches& patches);

}  // namespace kys_slam
