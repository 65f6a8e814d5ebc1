// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>

#include "matching/landmark_search.h"
#include "motion/segment_carrier.h"
#include "motion/segment_carrying.h"

// Keypoints of another frame, found again in the segmented image.

namespace kys_slam {

namespace {

constexpr int kAround = 2;  // cells, on each side, whose segments a keypoint may be on

}  // namespace

/// The segments around a keypoint, each at the nearest of its cells.
std::vector<SegmentCarrier::Cell> SegmentCarrier::cells_around(const Keypoint& k,
                                                               std::span<const Cell> moved) const {
  const int column = static_cast<int>(std::floor((k.x + 0.5F) / carrying::kCell));
  const int row = static_cast<int>(std::floor((k.y + 0.5F) / carrying::kCell));
  std::vector<Cell> found;
  std::vector<int> distances;
  for (int y = std::max(0, row - kAround); y <= std::min(rows_ - 1, row + kAround); ++y) {
    for (int x = std::max(0, column - kAround); x <= std::min(columns_ - 1, column + kAround);
         ++x) {
      const Cell& cell = moved[static_cast<std::size_t>(y * columns_ + x)];
      if (cell.segment == 0) continue;
      const int distance = (x - column) * (x - column) + (y - row) * (y - row);
      const auto same = std::ranges::find(found, cell.segment, &Cell::segment);
      if (same == found.end()) {
        found.push_back(cell);
        distances.push_back(distance);
      } else if (int& least = distances[static_cast<std::size_t>(same - found.begin())];
                 distance < least) {
        *same = cell;
        least = distance;
      }
    }
  }
  return found;
}

/// A corner at the edge of a segment lies on one side of it, which geometry, exact to some pixels,
/// cannot tell; its own pixel in the image can. It is searched where the motion of each segment
/// around it puts it.
void SegmentCarrier::find_again(const FrameFeatures& now, const Rigid3& T_s_now,
                                const SegmentShifts& shifts, std::span<const Cell> moved,
                                const SegmentSearch& search,
                                std::vector<std::uint16_t>& numbers) const {
  std::vector<SearchQuery> queries;
  std::vector<std::size_t> sources;
  for (std::size_t i = 0; i < now.size(); ++i) {
    const Keypoint& k = now.keypoint(i);
    for (const Cell& cell : cells_around(k, moved)) {
      const double depth = now.has_stereo(i) ? now.depth(i) : cell.depth;
      const Eigen::Vector3d p_s =
          T_s_now * camera_.back_project(k.x, k.y, depth) - shifts[cell.segment - 1U];
      if (p_s.z() < carrying::kNearest) continue;
      Eigen::Vector3d pixel = camera_.project_stereo(p_s);
      // The depth of a cell is too coarse to compare disparities.
      if (!now.has_stereo(i)) pixel.z() = std::numeric_limits<double>::quiet_NaN();
      SearchQuery query = query_for_feature(now, i, pixel, search.scales);
      query.radius = search.radius * search.scales.scale[k.octave];
      queries.push_back(query);
      sources.push_back(i);
    }
  }
  SearchOptions options;
  options.max_distance = search.max_distance;
  options.ratio = search.ratio;
  options.check_rotation = true;
  kys::Statistics unused;
  const std::vector<SearchMatch> matches =
      search_features(*features_, search.scales, queries, options, *search.model, unused);
  std::vector<float> least(now.size(), std::numeric_limits<float>::infinity());
  for (std::size_t q = 0; q < matches.size(); ++q) {
    const std::size_t i = sources[q];
    if (matches[q].feature < 0 || matches[q].distance >= least[i]) continue;
    const std::uint16_t segment = segment_of_feature_[static_cast<std::size_t>(matches[q].feature)];
    if (segment == 0) continue;
    least[i] = matches[q].distance;
    numbers[i] = segment;
  }
}

}  // namespace kys_slam
