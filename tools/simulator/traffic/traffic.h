// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "simulator/common/feature_path.h"

namespace kys_slam::simulator {

/// \throws InputError when it is none of none, light, city, jam.
Traffic parse_traffic(const std::string& name);

/// Moving objects along a path. On a road: vehicles ahead in the camera's lane, which drive as the
/// camera does one or two seconds later, and continue straight where the camera turns; oncoming,
/// overtaking and crossing vehicles; crossing people, mostly where the camera waits; cycles; people
/// on the pavement. Indoors (no ground): people who walk through the view, some of whom carry
/// objects. No object comes nearer to the camera than 1 m.
std::vector<FeatureObject> make_traffic(const FeaturePath& path, Traffic density,
                                        std::uint64_t seed);

}  // namespace kys_slam::simulator
