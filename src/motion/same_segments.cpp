// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <tuple>

#include "motion/segment_carrier.h"

namespace kys_slam {

namespace {

// Share of the samples that must fall on a segment. Much of an object may be hidden in one of the
// two images; other objects are rarely as far away at the same place.
constexpr double kOverlap = 0.3;
constexpr int kLeastVotes = 3;

}  // namespace

std::vector<std::uint16_t> same_segments(const SegmentCarrier& before, const SegmentCarrier& now,
                                         const Rigid3& T_before_now, const SegmentShifts& shifts,
                                         const kys::InitialBelief& start) {
  struct Pair {
    int votes;
    std::uint16_t now, before;
  };
  // A network calls one vehicle car in an image and truck in the next: classes that move by
  // themselves are compared as one.
  const auto pooled = [&](std::uint16_t label) {
    return start.mobility(label) == kys::Mobility::kMobile;
  };
  std::vector<Pair> pairs;
  for (std::size_t k = 0; k < now.segments().size(); ++k) {
    const auto segment = static_cast<std::uint16_t>(k + 1);
    if (!now.is_thing(segment)) continue;
    const std::uint16_t label = now.segments()[k].label;
    const std::vector<Eigen::Vector3d> points = now.sample(segment);
    std::map<std::uint16_t, int> votes;
    for (const Eigen::Vector3d& p : points) {
      const std::uint16_t old = before.segment_of(p, T_before_now, shifts);
      if (old == 0 || !before.is_thing(old)) continue;
      const std::uint16_t old_label = before.segments()[old - 1U].label;
      if (old_label == label || (pooled(label) && pooled(old_label))) ++votes[old];
    }
    const double enough =
        std::max<double>(kLeastVotes, kOverlap * static_cast<double>(points.size()));
    for (const auto& [old, count] : votes) {
      if (count >= enough) pairs.push_back({count, segment, old});
    }
  }
  std::ranges::sort(pairs, [](const Pair& a, const Pair& b) {
    return std::tuple(-a.votes, a.now, a.before) < std::tuple(-b.votes, b.now, b.before);
  });
  std::vector<std::uint16_t> same(now.segments().size(), 0);
  std::vector<std::uint8_t> taken(before.segments().size() + 1, 0);
  for (const Pair& pair : pairs) {
    if (same[pair.now - 1U] != 0 || taken[pair.before] != 0) continue;
    same[pair.now - 1U] = pair.before;
    taken[pair.before] = 1;
  }
  return same;
}

}  // namespace kys_slam
