// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/report.h>
#include <kys_slam/settings.h>
#include <kys_slam/system.h>

#include <deque>

namespace kys_slam {

class Map;

/// Of all frames of a run: a hundred megabytes in an hour, so they are neither copied nor moved.
using FrameReports = std::deque<FrameReport>;

/// Access to private parts of the public classes, for the core and its tests.
struct PrivateAccess {
  static const SettingsData& data(const Settings& settings) { return *settings.data_; }
  /// The map itself; valid after `finish`.
  static const Map& map(const System& system);
  /// Of all frames fed; valid after `finish`.
  static const FrameReports& reports(const System& system);
};

inline const Map& map_of(const System& system) {
  return PrivateAccess::map(system);
}

inline const FrameReports& reports_of(const System& system) {
  return PrivateAccess::reports(system);
}

}  // namespace kys_slam
