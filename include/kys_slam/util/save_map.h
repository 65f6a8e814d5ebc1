#pragma once

#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <filesystem>
#include <string>

namespace kys_slam {

/// Saves the map to `file`, or to `output`/saved.map when `file` cannot be written.
/// \throws InputError when `file` could not be written; the message says where the map is instead.
inline void save_map_or_beside(const System& system, const std::filesystem::path& file,
                               const std::filesystem::path& output) {
  try {
    system.save_map(file);
  } catch (const InputError& error) {
    const std::filesystem::path instead = output / "saved.map";
    try {
      system.save_map(instead);
    } catch (const InputError&) {
      throw error;
    }
    throw InputError(std::string(error.what()) + "; the map is in " + instead.string());
  }
}

}  // namespace kys_slam
