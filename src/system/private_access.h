#pragma once

#include <kys_slam/settings.h>
#include <kys_slam/system.h>

namespace kys_slam {

class Map;

/// What the core's own files and its tests see of the public classes, and users do not.
struct PrivateAccess {
  static const SettingsData& data(const Settings& settings) { return *settings.data_; }
  /// The map itself; valid after `finish`.
  static const Map& map(const System& system);
};

inline const Map& map_of(const System& system) {
  return PrivateAccess::map(system);
}

}  // namespace kys_slam
