// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include <cstddef>
#include <vector>

#include "map/map.h"
#include "optimization/rig_bundle.h"

namespace kys_slam {

/// What some keyframes measured, for adjust_rig: of the landmarks that at least `min_observers` of
/// them observe every n-th, such that there are about `most_observations` at most. One keyframe of
/// every sub-map stays. Disparities of octaves above `coarsest` (px per px) are left out.
struct RigView {
  RigProblem problem;
  std::vector<KeyFrameId> poses;      ///< of the problem, increasing
  std::vector<LandmarkId> landmarks;  ///< of its points, increasing

  /// Moves keyframes and landmarks to where the solved problem has them.
  void write_to(Map& map) const;
};
RigView rig_view(const Map& map, std::vector<KeyFrameId> poses, int min_observers,
                 std::size_t most_observations, float coarsest = MapSelection().coarsest_disparity);

/// The newest keyframes, by id.
std::vector<KeyFrameId> newest_keyframes(const Map& map, std::size_t most);

}  // namespace kys_slam
