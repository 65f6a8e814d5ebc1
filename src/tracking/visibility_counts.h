// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "map/keyframe_message.h"

namespace kys_slam {

/// How often landmarks were predicted to be in view, and found, since the last keyframe.
class VisibilityCounts {
 public:
  void add_visible(LandmarkId id) { add({id, 1, 0}); }
  /// \param id was added as visible
  void add_found(LandmarkId id) { add({id, 0, 1}); }
  /// All counts, by id; none is left.
  [[nodiscard]] std::vector<VisibilityCount> take();

 private:
  static constexpr std::size_t kFirstMerge = 8192;

  void add(const VisibilityCount& count) {
    counts_.push_back(count);
    if (counts_.size() >= merge_at_) merge();
  }
  /// Leaves one count per landmark, by id.
  void merge();

  std::vector<VisibilityCount> counts_;  // several of one landmark, until they are merged
  std::size_t merge_at_ = kFirstMerge;
};

}  // namespace kys_slam
