#pragma once

#include <filesystem>

#include "priors/builder/build_sequence.h"

namespace kys_slam {

/// Opens a sequence folder for the builder. \throws InputError.
BuildSequence open_build_sequence(const std::filesystem::path& folder);

}  // namespace kys_slam
