#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>

namespace kys_slam {

/// Reads a YAML file of at most 1 MB that is a plain tree: no anchors and aliases, which can refer
/// to themselves or grow without end, no tags, one document, at most 16 levels and 20000 values.
/// A first line that begins with '%' (OpenCV's "%YAML:1.0", which is no YAML) is left out.
/// \throws InputError naming the file
YAML::Node load_yaml(const std::filesystem::path& path);

/// The same of a text; `name` stands for the file in messages.
YAML::Node parse_yaml(std::string text, const std::string& name);

}  // namespace kys_slam
