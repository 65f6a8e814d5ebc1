// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include <string>

#include "map/map.h"

namespace kys_slam {

/// What some keyframes of a map measured. \throws InputError naming the map (`name`) when none of
/// its landmarks is observed often enough
MapObservations observations_of_map(const Map& map, const MapSelection& selection,
                                    const std::string& name);

}  // namespace kys_slam
