#include "tracking/visibility_counts.h"

#include <algorithm>

namespace kys_slam {

void VisibilityCounts::add_visible(LandmarkId id) {
  if (VisibilityCount* count = counts_.find(id)) {
    count->visible += 1;
  } else {
    counts_.put(id, {id, 1, 0});
    ids_.push_back(id);
  }
}

std::vector<VisibilityCount> VisibilityCounts::take() {
  std::sort(ids_.begin(), ids_.end());
  std::vector<VisibilityCount> counts;
  counts.reserve(ids_.size());
  for (const LandmarkId id : ids_) {
    counts.push_back(counts_.at(id));
    counts_.erase(id);
  }
  ids_.clear();
  return counts;
}

}  // namespace kys_slam
