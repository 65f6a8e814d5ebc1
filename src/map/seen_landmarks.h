// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "map/map.h"
#include "map/sort_ids.h"

namespace kys_slam {

/// Landmarks observed by at least one of the keyframes, by id, each once.
inline std::vector<LandmarkId> landmarks_seen_by(const Map& map,
                                                 const std::vector<KeyFrameId>& keyframes) {
  std::vector<LandmarkId> seen;
  for (const KeyFrameId id : keyframes) {
    for (const LandmarkId landmark : map.keyframe(id).landmarks) {
      if (landmark.valid()) seen.push_back(landmark);
    }
  }
  sort_unique(seen);
  return seen;
}

}  // namespace kys_slam
