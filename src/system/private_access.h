// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/settings.h>
#include <kys_slam/system.h>

namespace kys_slam {

class Map;

/// Access to private parts of the public classes, for the core and its tests.
struct PrivateAccess {
  static const SettingsData& data(const Settings& settings) { return *settings.data_; }
  /// The map itself; valid after `finish`.
  static const Map& map(const System& system);
};

inline const Map& map_of(const System& system) {
  return PrivateAccess::map(system);
}

}  // namespace kys_slam
