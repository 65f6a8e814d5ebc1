#pragma once

#include <cstdint>

#include "map/ids.h"

namespace kys_slam {

/// Hands out ids of new landmarks. Tracker and back end make landmarks at the same time and neither
/// waits for the other, so each has every second id.
class LandmarkIdAllocator {
 public:
  enum class Maker : std::uint32_t { kTracker = 0, kBackEnd = 1 };

  explicit LandmarkIdAllocator(Maker maker) : next_{static_cast<std::uint32_t>(maker)} {}

  /// Goes on after a map whose ids are all below `id_end`.
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
