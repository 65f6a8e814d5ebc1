// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/panoptic.h"

namespace kys_slam {

std::vector<SegmentShape> segment_shapes(const SegmentRuns& runs, std::size_t segment_count) {
  std::vector<SegmentShape> shapes(segment_count);
  for (int y = 0; y < runs.rows(); ++y) {
    for (const SegmentRun& run : runs.row(y)) {
      if (run.segment == 0) continue;
      SegmentShape& shape = shapes[run.segment - 1u];
      const double length = run.x1 - run.x0;
      shape.area += static_cast<std::uint32_t>(run.x1 - run.x0);
      shape.u += length * 0.5 * (run.x0 + run.x1 - 1);
      shape.v += length * y;
    }
  }
  for (SegmentShape& shape : shapes) {
    if (shape.area == 0) continue;
    shape.u /= shape.area;
    shape.v /= shape.area;
  }
  return shapes;
}

std::vector<std::uint8_t> stuff_mask(const PanopticMap& map) {
  std::vector<std::uint8_t> is_stuff(map.segments.size() + 1, 0);
  for (std::size_t k = 0; k < map.segments.size(); ++k) is_stuff[k + 1] = !map.segments[k].thing;
  return is_stuff;
}

}  // namespace kys_slam
