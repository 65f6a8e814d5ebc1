// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/visibility_counts.h"

#include <algorithm>

namespace kys_slam {

void VisibilityCounts::merge() {
  std::ranges::sort(counts_, {}, &VisibilityCount::id);
  std::size_t end = 0;
  for (const VisibilityCount& count : counts_) {
    if (end > 0 && counts_[end - 1].id == count.id) {
      counts_[end - 1].visible += count.visible;
      counts_[end - 1].found += count.found;
    } else {
      counts_[end++] = count;
    }
  }
  counts_.resize(end);
  merge_at_ = std::max(kFirstMerge, 2 * end);
}

std::vector<VisibilityCount> VisibilityCounts::take() {
  merge();
  merge_at_ = kFirstMerge;
  std::vector<VisibilityCount> counts = counts_;
  counts_.clear();
  return counts;
}

}  // namespace kys_slam
