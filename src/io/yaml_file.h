// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>

namespace kys_slam {

/// Reads a YAML file of at most 1 MB that is a plain tree: one document, no tags, at most 16 levels
/// and 20000 values, no anchors and aliases, which can refer to themselves or grow without limit. A
/// first line that begins with '%' (OpenCV's "%YAML:1.0", which is not valid YAML) is skipped.
/// \throws InputError naming the file
YAML::Node load_yaml(const std::filesystem::path& path);

/// The same for a text; `name` is used in messages.
YAML::Node parse_yaml(std::string text, const std::string& name);

/// A number for a YAML file, with as few digits as give the same number back.
std::string yaml_number(double value);

}  // namespace kys_slam
