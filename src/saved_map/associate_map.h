// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/saved_map.h>

#include "map/map.h"

namespace kys_slam {

/// SavedMap::associate().
AssociationReport associate_map(Map& map);

}  // namespace kys_slam
