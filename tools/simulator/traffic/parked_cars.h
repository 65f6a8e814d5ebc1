// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/common/feature_path.h"

namespace kys_slam::simulator {

/// Parked cars at the kerbs of a road, in runs: to the right of the camera's lane and to the left
/// of the opposite lane, never on the path of the camera. Empty for a path without ground.
std::vector<FeatureObject> park_cars(const FeaturePath& path, std::uint64_t seed);

}  // namespace kys_slam::simulator
