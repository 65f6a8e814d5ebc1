// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/segment_runs.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// Visits pixels of a regular grid in every selected segment, row by row. Large segments have a
/// coarser grid: about 2000 pixels of each or more, but fewer than 8000, are visited (the step is
/// rounded down, so that segments below 8000 pixels are visited whole).
/// \param segments number of segments plus one
/// \param is_looked_at whether a segment is selected, by its number from 1 on
/// \param visit called with segment, x, y
template <typename IsLookedAt, typename Visit>
void for_each_on_grid(const SegmentRuns& runs, std::size_t segments, const IsLookedAt& is_looked_at,
                      const Visit& visit) {
  constexpr double kPixels = 2000;  // per segment, at a step that is not rounded
  std::vector<std::uint32_t> area(segments, 0);
  for (const SegmentRun& run : runs.runs) area[run.segment] += run.x1 - run.x0;
  for (int y = 0; y < runs.rows(); ++y) {
    for (const SegmentRun& run : runs.row(y)) {
      if (run.segment == 0 || !is_looked_at(run.segment)) continue;
      const int step = std::max(1, static_cast<int>(std::sqrt(area[run.segment] / kPixels)));
      if (y % step != 0) continue;
      for (int x = (run.x0 + step - 1) / step * step; x < run.x1; x += step) {
        visit(run.segment, x, y);
      }
    }
  }
}

}  // namespace kys_slam
