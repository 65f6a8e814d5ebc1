// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "map/replica.h"

namespace kys_slam {

/// The part of the map around a frame.
struct LocalMap {
  std::vector<KeyFrameId> keyframes;  ///< those that observe its landmarks, then their neighbours
  std::vector<LandmarkId> landmarks;  ///< of these keyframes, each once
  KeyFrameId reference;               ///< the keyframe that shares most landmarks with the frame
};

/// Collects the local map of a frame (ORB-SLAM, Sec. V-D): keyframes that observe the frame's
/// landmarks, and for each its best covisible neighbour, child and parent that are not included
/// yet; none of these is added to `max_keyframes` or more. Empty when no keyframe observes the
/// frame's landmarks.
class LocalMapGatherer {
 public:
  explicit LocalMapGatherer(std::size_t max_keyframes = 80) : max_keyframes_(max_keyframes) {}
  LocalMap gather(const Replica& replica, std::span<const LandmarkId> frame_landmarks);

 private:
  std::size_t max_keyframes_;
  std::vector<int> votes_;      // by keyframe id, zero between calls
  std::vector<bool> included_;  // by landmark id
};

}  // namespace kys_slam
