// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_snapshot.h>

namespace kys_slam {

class Map;

/// A copy of the keyframes, landmarks and edges of a map. The caller sets `frames` and
/// `main_submap`.
MapSnapshot take_snapshot(const Map& map);

}  // namespace kys_slam
