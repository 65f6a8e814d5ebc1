// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "map/ids.h"

namespace kys_slam {

/// Allocates ids of new landmarks. Tracker and back end create landmarks in parallel without
/// synchronisation, so the tracker uses even ids and the back end odd ids.
class LandmarkIdAllocator {
 public:
  enum class Maker : std::uint32_t { kTracker = 0, kBackEnd = 1 };

  explicit LandmarkIdAllocator(Maker maker) : next_{static_cast<std::uint32_t>(maker)} {}

  /// Continues after a map whose ids are all below `id_end`.
  void continue_after(std::uint32_t id_end) { next_.value = id_end + id_end % 2 + next_.value % 2; }
  LandmarkId next() {
    const LandmarkId id = next_;
    next_.value += 2;
    return id;
  }

 private:
  LandmarkId next_;
};

}  // namespace kys_slam
