// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

#include "simulator/worlds/world.h"

namespace kys_slam::simulator {

/// Points on the static surfaces that the left camera sees from at most 60 m in one of up to 20
/// frames, uniform by area, as binary PLY: x, y, z (m) and the outward normal in the frame of the
/// sequence's ground truth, and the class. The same world, count and seed give the same bytes.
/// \throws InputError when so many points are not seen
std::string surface_ply(const World& world, std::int64_t count, std::uint64_t seed);

}  // namespace kys_slam::simulator
