// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/saved_map.h>

#include <atomic>

#include "map/map.h"

namespace kys_slam {

/// SavedMap::merge on maps.
MergeReport merge_map(Map& map, const Map& other, const std::string& name,
                      const std::atomic<bool>* stop);

}  // namespace kys_slam
