// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/object_segments.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "priors/fusion/object_claims.h"

namespace kys_slam {
namespace {

constexpr double kApartSpeed = 1;       // m/s, between things that move differently; and
constexpr double kApartDeviations = 3;  // standard deviations of the difference

/// Numbers the parts of every input segment that has several.
void number_parts(PanopticMap& panoptic) {
  std::map<std::pair<std::uint16_t, std::uint32_t>, int> count;
  for (const InputSegment& s : panoptic.segments) {
    if (s.thing) ++count[{s.label, s.input_id}];
  }
  std::map<std::pair<std::uint16_t, std::uint32_t>, std::uint16_t> next;
  for (InputSegment& s : panoptic.segments) {
    if (!s.thing) continue;
    const std::pair key(s.label, s.input_id);
    s.part = count[key] > 1 ? ++next[key] : std::uint16_t{0};
  }
}

}  // namespace

Claims find_claims(std::span<const ExpectedThing> expected, const PanopticMap& panoptic) {
  Claims claims(panoptic.segments.size() + 1);
  for (std::size_t t = 0; t < expected.size(); ++t) {
    for (const MaskRun& run : expected[t].mask) {
      if (run.y < 0 || run.y >= panoptic.runs.rows()) continue;
      const auto row = panoptic.runs.row(run.y);
      auto at = std::partition_point(row.begin(), row.end(),
                                     [&](const SegmentRun& r) { return r.x1 <= run.x0; });
      for (; at != row.end() && at->x0 < run.x1; ++at) {
        if (at->segment == 0 || !panoptic.segments[at->segment - 1U].thing) continue;
        claims[at->segment][t] += std::min<int>(at->x1, run.x1) - std::max<int>(at->x0, run.x0);
      }
    }
  }
  return claims;
}

bool move_apart(const std::optional<ThingMotion>& a, const std::optional<ThingMotion>& b) {
  if (!a || !b) return false;
  const double difference = (a->velocity - b->velocity).norm();
  return difference > kApartSpeed && difference > kApartDeviations * std::hypot(a->sigma, b->sigma);
}

void make_objects(const ImageOf<float>& disparity, const ObjectClasses& classes,
                  std::span<const ExpectedThing> expected, PanopticMap& panoptic) {
  if (panoptic.runs.empty()) panoptic.runs = find_runs(panoptic.map);
  split_merged(expected, panoptic);
  join_parts(disparity, classes, expected, panoptic);
  number_parts(panoptic);
}

}  // namespace kys_slam
