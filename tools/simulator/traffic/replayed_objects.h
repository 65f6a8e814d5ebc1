// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "simulator/common/feature_path.h"

namespace kys_slam::simulator {

/// The objects of a rendered world, from its objects.csv; frames as in the world, which has
/// `frames`. \throws InputError naming the file and line
std::vector<FeatureObject> read_objects(const std::filesystem::path& file, std::size_t frames);

}  // namespace kys_slam::simulator
