#include "priors/builder/panoptic.h"

#include "priors/format/run_end.h"

namespace kys_slam {

SegmentRuns find_runs(const ImageOf<std::uint16_t>& map) {
  SegmentRuns result;
  result.row_begin.reserve(static_cast<std::size_t>(map.height()) + 1);
  result.runs.reserve(static_cast<std::size_t>(map.height()) * 24);
  const int width = map.width();
  for (int y = 0; y < map.height(); ++y) {
    result.row_begin.push_back(static_cast<std::uint32_t>(result.runs.size()));
    const std::uint16_t* row = map.row(y);
    for (int x = 0; x < width;) {
      const int end = run_end(row, x, width);
      result.runs.push_back(
          {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(end), row[x]});
      x = end;
    }
  }
  result.row_begin.push_back(static_cast<std::uint32_t>(result.runs.size()));
  return result;
}

std::vector<SegmentShape> segment_shapes(const SegmentRuns& runs, std::size_t segment_count) {
  std::vector<SegmentShape> shapes(segment_count);
  for (std::size_t y = 0; y + 1 < runs.row_begin.size(); ++y) {
    for (std::uint32_t i = runs.row_begin[y]; i < runs.row_begin[y + 1]; ++i) {
      const SegmentRun& run = runs.runs[i];
      if (run.segment == 0) continue;
      SegmentShape& shape = shapes[run.segment - 1u];
      const double length = run.x1 - run.x0;
      shape.area += static_cast<std::uint32_t>(run.x1 - run.x0);
      shape.u += length * 0.5 * (run.x0 + run.x1 - 1);
      shape.v += length * static_cast<double>(y);
    }
  }
  for (SegmentShape& shape : shapes) {
    if (shape.area == 0) continue;
    shape.u /= shape.area;
    shape.v /= shape.area;
  }
  return shapes;
}

}  // namespace kys_slam
