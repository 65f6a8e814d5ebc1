// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "priors/fusion/object_claims.h"

namespace kys_slam {
namespace {

constexpr int kBorderReach = 3;  // px, between neighbours: borders of masks are not exact
constexpr float kBorderStep = 0.5F, kBorderShare = 0.04F;  // px and share of the disparity: the
                                                           // same surface on both sides of a border
constexpr float kDepthApart = 0.5F, kDepthShare = 0.1F;    // likewise: medians of two objects
constexpr int kLeastBorder = 8;      // neighbours with a disparity, that tell something
constexpr double kContinuous = 0.6;  // share of these on one surface
constexpr double kSmallPart = 0.25;  // of the area of what surrounds it
constexpr double kSurrounded = 0.4;  // share of a small part's border
constexpr double kClaimed = 0.5;     // of a segment under the mask of the thing it is of
constexpr int kEstablished = 10;     // images in which a thing was seen by itself: it is one
constexpr std::size_t kOfNone = std::numeric_limits<std::size_t>::max();

/// What two segments have in common, in pairs of pixels `kBorderReach` apart.
struct CommonBorder {
  int pairs = 0;
  int measured = 0;    ///< both have a disparity
  int continuous = 0;  ///< and it is that of one surface
};

struct CommonBorders {
  std::map<std::pair<std::uint16_t, std::uint16_t>, CommonBorder> of_pair;  ///< lower number first
  std::vector<int> around;  ///< pairs with anything else, by segment number
};

CommonBorders find_borders(const ImageOf<float>& disparity, const ImageOf<std::uint16_t>& map,
                           const std::vector<bool>& counts) {
  CommonBorders borders;
  borders.around.assign(counts.size(), 0);
  const auto look = [&](std::uint16_t a, std::uint16_t b, float da, float db) {
    if (a == b) return;
    if (counts[a]) ++borders.around[a];
    if (counts[b]) ++borders.around[b];
    if (!counts[a] || !counts[b]) return;
    CommonBorder& border = borders.of_pair[{std::min(a, b), std::max(a, b)}];
    ++border.pairs;
    if (!(da > 0 && db > 0)) return;
    ++border.measured;
    if (std::abs(da - db) <= kBorderStep + kBorderShare * std::min(da, db)) ++border.continuous;
  };
  for (int y = 0; y < map.height(); ++y) {
    const std::uint16_t* row = map.row(y);
    const float* d = disparity.row(y);
    for (int x = 0; x + kBorderReach < map.width(); ++x) {
      if (row[x] != row[x + kBorderReach])
        look(row[x], row[x + kBorderReach], d[x], d[x + kBorderReach]);
    }
    if (y + kBorderReach >= map.height()) continue;
    const std::uint16_t* below = map.row(y + kBorderReach);
    const float* e = disparity.row(y + kBorderReach);
    for (int x = 0; x < map.width(); ++x) {
      if (row[x] != below[x]) look(row[x], below[x], d[x], e[x]);
    }
  }
  return borders;
}

/// Joins the segments of an image that are parts of one object.
class Joiner {
 public:
  Joiner(const ImageOf<float>& disparity, const ObjectClasses& classes,
         std::span<const ExpectedThing> expected, PanopticMap& panoptic)
      : classes_(classes),
        expected_(expected),
        panoptic_(panoptic),
        claims_(find_claims(expected, panoptic)),
        root_(panoptic.segments.size() + 1),
        area_(root_.size(), 0),
        members_(root_.size()) {
    std::vector<bool> counts(root_.size(), false);
    for (std::size_t k = 1; k < root_.size(); ++k) {
      const InputSegment& s = panoptic.segments[k - 1];
      counts[k] = s.thing && classes.moves(s.label);
      members_[k] = {k};
    }
    std::iota(root_.begin(), root_.end(), 0);
    for (const SegmentRun& run : panoptic.runs.runs) area_[run.segment] += run.x1 - run.x0;
    borders_ = find_borders(disparity, panoptic.map, counts);
    medians_ = median_disparities(disparity, panoptic);
  }

  void run() {
    using Edge = std::pair<std::pair<std::uint16_t, std::uint16_t>, CommonBorder>;
    std::vector<Edge> edges(borders_.of_pair.begin(), borders_.of_pair.end());
    // The longest borders first.
    std::stable_sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
      return a.second.continuous > b.second.continuous;
    });
    bool any = false;
    for (const auto& [pair, border] : edges) {
      const std::size_t a = root_[pair.first], b = root_[pair.second];
      if (a == b || !is_one(pair.first, pair.second, border) || are_two(a, b)) continue;
      join(a, b);
      any = true;
    }
    if (any) rewrite();
  }

 private:
  [[nodiscard]] bool is_one(std::uint16_t a, std::uint16_t b, const CommonBorder& border) const {
    if (border.measured < kLeastBorder || border.continuous < kContinuous * border.measured) {
      return false;
    }
    const float da = medians_[a], db = medians_[b];
    if (std::abs(da - db) > kDepthApart + kDepthShare * std::max(da, db)) return false;
    const std::uint16_t la = panoptic_.segments[a - 1U].label;
    const std::uint16_t lb = panoptic_.segments[b - 1U].label;
    // Two of one class are two instances, or parts split by depth.
    if (la != lb && classes_.belong_together(la, lb)) return true;
    const bool first = area_[a] < area_[b];
    const std::uint16_t small = first ? a : b, large = first ? b : a;
    return la != lb && area_[small] < kSmallPart * area_[large] &&
           border.pairs >= kSurrounded * borders_.around[small];
  }

  /// The known thing that a segment mostly lies on. Depths are not compared: those of what comes
  /// towards the camera change much from one frame to the next.
  [[nodiscard]] std::size_t thing_of(std::size_t segment) const {
    std::size_t best = kOfNone;
    int most = static_cast<int>(std::ceil(kClaimed * area_[segment]));
    for (const auto& [t, pixels] : claims_[segment]) {
      if (pixels < most) continue;
      most = pixels + 1;
      best = t;
    }
    return best;
  }

  /// Whether two sets of segments are known to be two things.
  [[nodiscard]] bool are_two(std::size_t a, std::size_t b) const {
    for (const std::size_t i : members_[a]) {
      const std::size_t s = thing_of(i);
      for (const std::size_t j : members_[b]) {
        const std::size_t t = thing_of(j);
        if (s == kOfNone || t == kOfNone || s == t) continue;
        const ExpectedThing &one = expected_[s], &other = expected_[t];
        if (move_apart(one.motion, other.motion) ||
            std::min(one.frames, other.frames) >= kEstablished) {
          return true;
        }
      }
    }
    return false;
  }

  void join(std::size_t a, std::size_t b) {
    const std::size_t to = std::min(a, b), from = std::max(a, b);
    for (const std::size_t k : members_[from]) root_[k] = to;
    members_[to].insert(members_[to].end(), members_[from].begin(), members_[from].end());
    members_[from].clear();
  }

  /// The class of most pixels, and the number of the largest segment.
  [[nodiscard]] InputSegment joined(const std::vector<std::size_t>& members) const {
    std::map<std::uint16_t, std::uint32_t> area;  // by class
    std::size_t largest = members.front();
    for (const std::size_t k : members) {
      area[panoptic_.segments[k - 1].label] += area_[k];
      if (area_[k] > area_[largest] || (area_[k] == area_[largest] && k < largest)) largest = k;
    }
    InputSegment segment = panoptic_.segments[largest - 1];
    segment.label = std::max_element(area.begin(), area.end(), [](const auto& a, const auto& b) {
                      return a.second < b.second;
                    })->first;
    return segment;
  }

  void rewrite() {
    std::vector<InputSegment> segments;
    std::vector<std::uint16_t> number(root_.size(), 0);
    for (std::size_t k = 1; k < root_.size(); ++k) {
      if (root_[k] != k) continue;
      segments.push_back(joined(members_[k]));
      for (const std::size_t m : members_[k]) {
        number[m] = static_cast<std::uint16_t>(segments.size());
      }
    }
    for (int y = 0; y < panoptic_.runs.rows(); ++y) {
      std::uint16_t* row = panoptic_.map.row(y);
      for (const SegmentRun& run : panoptic_.runs.row(y)) {
        std::fill(row + run.x0, row + run.x1, number[run.segment]);
      }
    }
    panoptic_.segments = std::move(segments);
    panoptic_.runs = find_runs(panoptic_.map);
  }

  const ObjectClasses& classes_;
  std::span<const ExpectedThing> expected_;
  PanopticMap& panoptic_;
  Claims claims_;
  std::vector<std::size_t> root_;    // by segment number: the number that stands for its object
  std::vector<std::uint32_t> area_;  // px
  std::vector<std::vector<std::size_t>> members_;  // of what stands for an object
  CommonBorders borders_;
  std::vector<float> medians_;  // px
};

}  // namespace

void join_parts(const ImageOf<float>& disparity, const ObjectClasses& classes,
                std::span<const ExpectedThing> expected, PanopticMap& panoptic) {
  Joiner(disparity, classes, expected, panoptic).run();
}

}  // namespace kys_slam
