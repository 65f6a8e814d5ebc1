// SPDX-License-Identifier: BSD-3-Clause
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

/// Of the things whose masks a segment covers those that move apart from all others before them,
/// the one with most pixels first.
std::vector<std::size_t> covered_things(const std::map<std::size_t, int>& claims, double area,
                                        std::span<const ExpectedThing> expected) {
  std::vector<std::pair<int, std::size_t>> order;
  for (const auto& [t, pixels] : claims) {
    if (expected[t].frames < kLeastFrames || !expected[t].motion) continue;
    if (pixels < kCovered * area_of(expected[t].mask) || pixels < kLeastPart * area) continue;
    order.emplace_back(-pixels, t);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::size_t> chosen;
  for (const auto& [pixels, t] : order) {
    const bool apart = std::all_of(chosen.begin(), chosen.end(), [&](std::size_t other) {
      return move_apart(expected[t].motion, expected[other].motion);
    });
    if (apart) chosen.push_back(t);
  }
  return chosen;
}

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
void split_merged(std::span<const ExpectedThing> expected, PanopticMap& panoptic) {
  const Claims claims = find_claims(expected, panoptic);
  const std::vector<SegmentShape> shapes = segment_shapes(panoptic.runs, panoptic.segments.size());
  bool any = false;
  std::vector<InputSegment> segments;
  std::vector<std::uint16_t> number{0};  // new number of the first part, by segment number
  std::vector<std::vector<std::size_t>> things{{}};
  for (std::size_t k = 0; k < panoptic.segments.size(); ++k) {
    things.push_back(panoptic.segments[k].thing
                         ? covered_things(claims[k + 1], shapes[k].area, expected)
                         : std::vector<std::size_t>{});
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
