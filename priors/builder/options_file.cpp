// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/options_file.h"

#include <kys_slam/error.h>

#include <string>
#include <utility>
#include <vector>

#include "io/yaml_file.h"

namespace kys_slam {

void load_options(const std::filesystem::path& path, BuilderOptions& options) {
  std::vector<std::pair<std::string, std::string>> entries;
  try {
    const YAML::Node root = load_yaml(path);
    if (root.IsNull()) return;
    if (!root.IsMap()) throw InputError(path.string() + ": is not a list of sections");
    for (const auto& section : root) {
      const auto name = section.first.as<std::string>();
      if (!section.second.IsMap()) {
        throw InputError(path.string() + ": section " + name + " has no settings");
      }
      for (const auto& entry : section.second) {
        entries.emplace_back(name + "." + entry.first.as<std::string>(),
                             entry.second.as<std::string>());
      }
    }
  } catch (const YAML::Exception& error) {
    throw InputError(path.string() + ": " + error.what());
  }
  try {
    for (const auto& [key, value] : entries) set_option(options, key, value);
    options.check();
  } catch (const InputError& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

}  // namespace kys_slam
