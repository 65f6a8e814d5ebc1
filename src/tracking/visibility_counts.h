#pragma once

#include <vector>

#include "map/id_table.h"
#include "map/keyframe_message.h"

namespace kys_slam {

/// How often landmarks were predicted to be in view, and found, since the last keyframe.
class VisibilityCounts {
 public:
  void add_visible(LandmarkId id);
  /// \param id was added as visible
  void add_found(LandmarkId id) { counts_.at(id).found += 1; }
  /// All counts, by id; none is left.
  [[nodiscard]] std::vector<VisibilityCount> take();

 private:
  IdTable<LandmarkId, VisibilityCount> counts_;
  std::vector<LandmarkId> ids_;  // of counts_
};

}  // namespace kys_slam
