#pragma once

#include <kys_slam/map_snapshot.h>

namespace kys_slam {

class Map;

/// The keyframes, landmarks and edges of a map, by value. `frames` and `main_submap` are left to
/// the caller.
MapSnapshot take_snapshot(const Map& map);

}  // namespace kys_slam
