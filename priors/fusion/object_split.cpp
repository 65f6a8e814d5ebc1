// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/median.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "priors/fusion/object_claims.h"

namespace kys_slam {
namespace {

constexpr int kLeastFrames = 3;      // in which a thing was seen before it splits segments
constexpr double kCovered = 0.4;     // share of an expected mask on the segment; and
constexpr double kLeastPart = 0.15;  // of the segment under this mask

int area_of(const std::vector<MaskRun>& mask) {
  return std::accumulate(mask.begin(), mask.end(), 0,
                         [](int sum, const MaskRun& run) { return sum + run.x1 - run.x0; });
}

/// Median disparity (px; 0: not known) of a segment's pixels under a mask.
float disparity_under(const std::vector<MaskRun>& mask, const ImageOf<float>& disparity,
                      const ImageOf<std::uint16_t>& map, std::size_t segment) {
  std::vector<float> values;
  for (const MaskRun& run : mask) {
    if (run.y < 0 || run.y >= map.height()) continue;
    for (int x = std::max(0, run.x0); x < std::min(map.width(), run.x1); ++x) {
      if (map.at(x, run.y) == segment && disparity.at(x, run.y) > 0) {
        values.push_back(disparity.at(x, run.y));
      }
    }
  }
  return values.empty() ? 0.0F : median(values);
}

/// The things whose masks each segment covers, at their depths: of these the one with most pixels,
/// and those that move apart from all chosen before them. What stands before a thing covers its
/// mask as well, at another depth.
class CoveredThings {
 public:
  CoveredThings(const ImageOf<float>& disparity, std::span<const ExpectedThing> expected,
                const PanopticMap& panoptic)
      : disparity_(disparity),
        expected_(expected),
        panoptic_(panoptic),
        claims_(find_claims(expected, panoptic)),
        shapes_(segment_shapes(panoptic.runs, panoptic.segments.size())) {}

  /// \param segment its number
  [[nodiscard]] std::vector<std::size_t> of(std::size_t segment) const {
    const double area = shapes_[segment - 1].area;
    std::vector<std::pair<int, std::size_t>> order;
    for (const auto& [t, pixels] : claims_[segment]) {
      const ExpectedThing& thing = expected_[t];
      if (thing.frames < kLeastFrames || !thing.motion) continue;
      if (pixels < kCovered * area_of(thing.mask) || pixels < kLeastPart * area) continue;
      order.emplace_back(-pixels, t);
    }
    if (order.size() < 2) return {};
    std::erase_if(order, [&](const auto& entry) {
      const ExpectedThing& thing = expected_[entry.second];
      return !is_as_deep(thing, disparity_under(thing.mask, disparity_, panoptic_.map, segment));
    });
    std::sort(order.begin(), order.end());
    std::vector<std::size_t> chosen;
    for (const auto& entry : order) {
      const std::size_t t = entry.second;
      const bool apart = std::all_of(chosen.begin(), chosen.end(), [&](std::size_t other) {
        return move_apart(expected_[t].motion, expected_[other].motion);
      });
      if (apart) chosen.push_back(t);
    }
    return chosen;
  }

 private:
  const ImageOf<float>& disparity_;
  std::span<const ExpectedThing> expected_;
  const PanopticMap& panoptic_;
  Claims claims_;
  std::vector<SegmentShape> shapes_;
};

/// Gives the pixels of a segment to the things it covers: first what is under their masks, the
/// others to the nearest of these. \return the part of each pixel of `pixels`, from 0
std::vector<int> divide(const std::vector<std::pair<int, int>>& pixels, int width,
                        const std::vector<std::size_t>& things,
                        std::span<const ExpectedThing> expected) {
  std::map<std::pair<int, int>, std::size_t> index;
  for (std::size_t i = 0; i < pixels.size(); ++i) index[pixels[i]] = i;
  std::vector<int> part(pixels.size(), -1);
  std::vector<std::size_t> queue;
  for (std::size_t p = 0; p < things.size(); ++p) {
    for (const MaskRun& run : expected[things[p]].mask) {
      for (auto at = index.lower_bound({run.y, std::max(0, run.x0)});
           at != index.end() && at->first.first == run.y &&
           at->first.second < std::min(width, run.x1);
           ++at) {
        if (part[at->second] >= 0) continue;
        part[at->second] = static_cast<int>(p);
        queue.push_back(at->second);
      }
    }
  }
  for (std::size_t next = 0; next < queue.size(); ++next) {
    const auto [y, x] = pixels[queue[next]];
    for (const auto& place : {std::pair(y, x - 1), {y, x + 1}, {y - 1, x}, {y + 1, x}}) {
      const auto at = index.find(place);
      if (at == index.end() || part[at->second] >= 0) continue;
      part[at->second] = part[queue[next]];
      queue.push_back(at->second);
    }
  }
  for (int& p : part) p = std::max(p, 0);  // pieces without a mask
  return part;
}

}  // namespace

/// Splits what covers several known things.
void split_merged(const ImageOf<float>& disparity, std::span<const ExpectedThing> expected,
                  PanopticMap& panoptic) {
  const CoveredThings covered(disparity, expected, panoptic);
  bool any = false;
  std::vector<InputSegment> segments;
  std::vector<std::uint16_t> number{0};  // new number of the first part, by segment number
  std::vector<std::vector<std::size_t>> things{{}};
  for (std::size_t k = 0; k < panoptic.segments.size(); ++k) {
    things.push_back(panoptic.segments[k].thing ? covered.of(k + 1) : std::vector<std::size_t>{});
    number.push_back(static_cast<std::uint16_t>(segments.size() + 1));
    const std::size_t parts = std::max<std::size_t>(1, things.back().size());
    segments.insert(segments.end(), parts, panoptic.segments[k]);
    any |= parts > 1;
  }
  if (!any || segments.size() >= std::numeric_limits<std::uint16_t>::max()) return;
  std::vector<std::vector<std::pair<int, int>>> pixels(number.size());
  for (int y = 0; y < panoptic.runs.rows(); ++y) {
    std::uint16_t* row = panoptic.map.row(y);
    for (const SegmentRun& run : panoptic.runs.row(y)) {
      std::fill(row + run.x0, row + run.x1, number[run.segment]);
      if (things[run.segment].size() < 2) continue;
      for (int x = run.x0; x < run.x1; ++x) pixels[run.segment].emplace_back(y, x);
    }
  }
  for (std::size_t k = 1; k < number.size(); ++k) {
    if (things[k].size() < 2) continue;
    const std::vector<int> part = divide(pixels[k], panoptic.map.width(), things[k], expected);
    for (std::size_t i = 0; i < part.size(); ++i) {
      const auto [y, x] = pixels[k][i];
      panoptic.map.at(x, y) = static_cast<std::uint16_t>(number[k] + part[i]);
    }
  }
  panoptic.segments = std::move(segments);
  panoptic.runs = find_runs(panoptic.map);
}

}  // namespace kys_slam
