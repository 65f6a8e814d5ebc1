// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/segment_runs.h>

namespace kys_slam {

SegmentRuns find_runs(const ImageOf<std::uint16_t>& map) {
  SegmentRuns result;
  result.row_begin.reserve(static_cast<std::size_t>(map.height()) + 1);
  for (int y = 0; y < map.height(); ++y) {
    result.row_begin.push_back(static_cast<std::uint32_t>(result.runs.size()));
    const std::uint16_t* row = map.row(y);
    for (int x = 0, end = 0; x < map.width(); x = end) {
      end = run_end(row, x, map.width());
      result.runs.push_back(
          {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(end), row[x]});
    }
  }
  result.row_begin.push_back(static_cast<std::uint32_t>(result.runs.size()));
  return result;
}

}  // namespace kys_slam
