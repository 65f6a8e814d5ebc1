#pragma once

#include <cstddef>
#include <vector>

#include "map/map.h"
#include "optimization/rig_bundle.h"

namespace kys_slam {

/// What some keyframes measured, for adjust_rig: of the landmarks that at least `min_observers` of
/// them observe every n-th, such that there are about `most_observations` at most. One keyframe of
/// every sub-map stays. Disparities of coarse octaves are left out.
RigProblem rig_problem(const Map& map, const std::vector<KeyFrameId>& poses, int min_observers,
                       std::size_t most_observations);

/// The newest keyframes, by id.
std::vector<KeyFrameId> newest_keyframes(const Map& map, std::size_t most);

}  // namespace kys_slam
