// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "priors/fusion/options.h"

namespace kys_slam {

/// Sets the options in a YAML file of two levels (section: {name: value}). Other options keep their
/// values.
/// \throws InputError naming the file and the setting.
void load_options(const std::filesystem::path& path, BuilderOptions& options);

}  // namespace kys_slam
