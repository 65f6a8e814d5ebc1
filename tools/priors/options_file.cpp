#include "options_file.h"

#include <kys_slam/error.h>
#include <yaml-cpp/yaml.h>

namespace kys_slam {

void load_options(const std::filesystem::path& path, BuilderOptions& options) {
  try {
    const YAML::Node root = YAML::LoadFile(path.string());
    if (root.IsNull()) return;
    if (!root.IsMap()) throw InputError("is not a list of sections");
    for (const auto& section : root) {
      const auto name = section.first.as<std::string>();
      if (!section.second.IsMap()) throw InputError("section " + name + " has no settings");
      for (const auto& entry : section.second) {
        set_option(options, name + "." + entry.first.as<std::string>(),
                   entry.second.as<std::string>());
      }
    }
    options.check();
  } catch (const YAML::Exception& error) {
    throw InputError(path.string() + ": " + error.what());
  } catch (const InputError& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

}  // namespace kys_slam
