// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include "map/map.h"

namespace kys_slam {

/// SavedMap::update. \throws std::invalid_argument when `adjusted` is of another map, or a number
/// in it is not finite; the map is unchanged then
void adjust_map(Map& map, const MapObservations& adjusted);

}  // namespace kys_slam
