#pragma once

#include <filesystem>

#include "priors/builder/options.h"

namespace kys_slam {

/// Sets what a YAML file of two levels (section: {name: value}) gives; other options stay.
/// \throws InputError naming the file and the setting.
void load_options(const std::filesystem::path& path, BuilderOptions& options);

}  // namespace kys_slam
