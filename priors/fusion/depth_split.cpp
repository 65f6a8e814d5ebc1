// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/depth_split.h"

#include <kys_slam/util/median.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

constexpr float kStep = 0.5F, kStepShare = 0.04F;  // px and share of the disparity: neighbours of
                                                   // one surface differ by less
constexpr float kApart = 2, kApartShare = 0.1F;    // likewise: medians of two objects by more
constexpr std::uint32_t kLeastArea = 200;          // px of a surface; and
constexpr double kLeastShare = 0.1;                // of its piece's
constexpr int kRim = 3;                            // px: a surface has a core farther from its
constexpr double kLeastCore = 0.2;                 // border, with this share of its pixels
constexpr double kLeastMeasured = 0.5;             // of a part's pixels are on its surfaces

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

/// Sets of pixels. The first pixel of a set stands for it.
class PixelSets {
 public:
  explicit PixelSets(std::size_t pixels) : parent_(pixels, kNone) {}

  void add(std::uint32_t i) { parent_[i] = i; }
  [[nodiscard]] bool has(std::uint32_t i) const { return parent_[i] != kNone; }
  [[nodiscard]] std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t i, std::uint32_t j) {
    const std::uint32_t a = find(i), b = find(j);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// The smallest rectangle around a segment: columns x0 to x1 - 1, rows y0 to y1 - 1.
struct Box {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  [[nodiscard]] int width() const { return x1 - x0; }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(width()) * static_cast<std::size_t>(y1 - y0);
  }
  void include(const SegmentRun& run, int y) {
    if (x1 == 0) *this = {run.x0, y, run.x1, y};
    x0 = std::min<int>(x0, run.x0);
    x1 = std::max<int>(x1, run.x1);
    y1 = y + 1;
  }
};

/// The parts of one segment.
struct Parts {
  std::uint16_t count = 1;
  std::vector<std::uint16_t> of_pixel;  ///< of the box, from 1, 0: not of the segment
};

/// A set of pixels that is large enough to be an object.
struct Surface {
  std::uint32_t piece = 0;  ///< connected piece of the segment
  float disparity = 0;      ///< px, median
  std::uint32_t area = 0;   ///< px
  std::uint16_t part = 0;
};

/// Splits one segment. Pixels have numbers, row by row in its box.
class SegmentSplit {
 public:
  SegmentSplit(const ImageOf<float>& disparity, const ImageOf<std::uint16_t>& map,
               std::uint16_t segment, const Box& box)
      : width_(static_cast<std::uint32_t>(box.width())),
        d_(box.size()),
        inside_(box.size()),
        pieces_(box.size()),
        surfaces_(box.size()),
        of_pixel_(box.size(), kNone) {
    std::size_t i = 0;
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x, ++i) {
        inside_[i] = map.at(x, y) == segment;
        d_[i] = disparity.at(x, y);
      }
    }
  }

  Parts run() {
    connect(
        pieces_, [](std::uint32_t) { return true; },
        [](std::uint32_t, std::uint32_t) { return true; });
    connect(
        surfaces_, [this](std::uint32_t i) { return d_[i] > 0; },
        [this](std::uint32_t i, std::uint32_t j) {
          return std::abs(d_[i] - d_[j]) <= kStep + kStepShare * std::min(d_[i], d_[j]);
        });
    find_surfaces();
    Parts parts;
    parts.count = number_parts();
    if (parts.count == 1) return parts;
    parts.of_pixel = part_of_pixels();
    if (!are_measured(parts)) parts = {};
    return parts;
  }

 private:
  template <typename Visit>
  void for_each_pixel(const Visit& visit) const {
    for (std::uint32_t i = 0; i < inside_.size(); ++i) {
      if (inside_[i]) visit(i);
    }
  }

  /// \param counts does a pixel belong to a set? \param joined do two neighbours to the same one?
  template <typename Counts, typename Joined>
  void connect(PixelSets& sets, const Counts& counts, const Joined& joined) const {
    for_each_pixel([&](std::uint32_t i) {
      if (!counts(i)) return;
      sets.add(i);
      if (i % width_ > 0 && sets.has(i - 1) && joined(i, i - 1)) sets.join(i, i - 1);
      if (i >= width_ && sets.has(i - width_) && joined(i, i - width_)) sets.join(i, i - width_);
    });
  }

  /// Distance (px, the longer of both axes) to the nearest pixel that is not of the same surface,
  /// at most `kRim` + 1.
  [[nodiscard]] std::vector<std::uint8_t> distance_to_border() {
    const std::uint32_t w = width_ + 2;  // with a margin
    const auto h = static_cast<std::uint32_t>(inside_.size() / width_) + 2;
    std::vector<std::uint32_t> root(std::size_t{w} * h, kNone);
    std::vector<std::uint8_t> wide(root.size(), 0);
    const auto at = [&](std::uint32_t i) { return (i / width_ + 1) * w + i % width_ + 1; };
    for_each_pixel([&](std::uint32_t i) {
      if (surfaces_.has(i)) root[at(i)] = surfaces_.find(i);
    });
    const auto least = [&](std::uint32_t i, const auto& neighbours) {
      int nearest = kRim + 1;
      for (const std::uint32_t j : neighbours) {
        nearest = std::min(nearest, root[j] == root[i] ? wide[j] + 1 : 1);
      }
      return static_cast<std::uint8_t>(nearest);
    };
    for (std::uint32_t i = w; i < root.size() - w; ++i) {
      if (root[i] != kNone) wide[i] = least(i, std::array{i - w - 1, i - w, i - w + 1, i - 1});
    }
    for (auto i = static_cast<std::uint32_t>(root.size()) - w - 1; i >= w; --i) {
      if (root[i] == kNone) continue;
      wide[i] = std::min(wide[i], least(i, std::array{i + w + 1, i + w, i + w - 1, i + 1}));
    }
    std::vector<std::uint8_t> distance(inside_.size());
    for_each_pixel([&](std::uint32_t i) { distance[i] = wide[at(i)]; });
    return distance;
  }

  void find_surfaces() {
    std::vector<std::uint32_t> piece_area(inside_.size(), 0), area(inside_.size(), 0),
        core(inside_.size(), 0);
    const std::vector<std::uint8_t> distance = distance_to_border();
    for_each_pixel([&](std::uint32_t i) {
      ++piece_area[pieces_.find(i)];
      if (!surfaces_.has(i)) return;
      ++area[surfaces_.find(i)];
      core[surfaces_.find(i)] += distance[i] > kRim ? 1 : 0;
    });
    std::vector<std::vector<float>> disparities;
    for_each_pixel([&](std::uint32_t i) {
      if (!surfaces_.has(i)) return;
      const std::uint32_t root = surfaces_.find(i), piece = pieces_.find(i);
      if (area[root] < std::max<double>(kLeastArea, kLeastShare * piece_area[piece]) ||
          core[root] < kLeastCore * area[root]) {
        return;
      }
      if (root == i) {
        of_pixel_[root] = static_cast<std::uint32_t>(found_.size());
        found_.push_back({piece, 0, area[root], 0});
        disparities.emplace_back().reserve(area[root]);
      }
      of_pixel_[i] = of_pixel_[root];
      disparities[of_pixel_[i]].push_back(d_[i]);
    });
    for (std::size_t s = 0; s < found_.size(); ++s) found_[s].disparity = median(disparities[s]);
  }

  /// Numbers the parts, nearest first. \return how many there are
  std::uint16_t number_parts() {
    std::vector<Surface*> order;
    for (Surface& surface : found_) order.push_back(&surface);
    std::stable_sort(order.begin(), order.end(), [](const Surface* a, const Surface* b) {
      return a->disparity > b->disparity;
    });
    std::uint16_t part = 0;
    float before = 0;
    // Of two parts, one piece must have both.
    std::set<std::uint32_t> pieces;
    std::set<std::pair<std::uint32_t, std::uint16_t>> parts;
    for (Surface* surface : order) {
      const float d = surface->disparity;
      if (part == 0 || before - d > kApart + kApartShare * before) ++part;
      surface->part = part;
      before = d;
      pieces.insert(surface->piece);
      parts.emplace(surface->piece, part);
    }
    return parts.size() > pieces.size() ? part : std::uint16_t{1};
  }

  /// The part whose surfaces have most pixels.
  [[nodiscard]] std::uint16_t largest_part() const {
    std::vector<std::uint32_t> area(found_.size() + 1, 0);
    for (const Surface& surface : found_) area[surface.part] += surface.area;
    return static_cast<std::uint16_t>(std::max_element(area.begin(), area.end()) - area.begin());
  }

  /// Pixels of no surface go to the part nearest in the image; pieces without one to the largest.
  [[nodiscard]] std::vector<std::uint16_t> part_of_pixels() const {
    std::vector<std::uint16_t> part(inside_.size(), 0);
    std::vector<std::uint32_t> queue;
    for_each_pixel([&](std::uint32_t i) {
      if (of_pixel_[i] == kNone) return;
      part[i] = found_[of_pixel_[i]].part;
      queue.push_back(i);
    });
    for (std::size_t next = 0; next < queue.size(); ++next) {
      const std::uint32_t i = queue[next];
      const auto take = [&](std::uint32_t j) {
        if (!inside_[j] || part[j] != 0) return;
        part[j] = part[i];
        queue.push_back(j);
      };
      if (i % width_ > 0) take(i - 1);
      if (i % width_ < width_ - 1) take(i + 1);
      if (i >= width_) take(i - width_);
      if (i + width_ < inside_.size()) take(i + width_);
    }
    const std::uint16_t largest = largest_part();
    for_each_pixel([&](std::uint32_t i) {
      if (part[i] == 0) part[i] = largest;
    });
    return part;
  }

  /// Most of every part is on its surfaces. Where little of a segment is measured, what is measured
  /// is often wrong.
  [[nodiscard]] bool are_measured(const Parts& parts) const {
    std::vector<std::uint32_t> measured(parts.count + 1u, 0), area(parts.count + 1u, 0);
    for (const Surface& surface : found_) measured[surface.part] += surface.area;
    for (const std::uint16_t part : parts.of_pixel) ++area[part];
    for (std::size_t p = 1; p < area.size(); ++p) {
      if (measured[p] < kLeastMeasured * area[p]) return false;
    }
    return true;
  }

  std::uint32_t width_;  ///< px, of the box
  std::vector<float> d_;
  std::vector<std::uint8_t> inside_;
  PixelSets pieces_, surfaces_;
  std::vector<std::uint32_t> of_pixel_;  ///< index in found_
  std::vector<Surface> found_;
};

std::vector<Box> boxes_of(const PanopticMap& panoptic) {
  std::vector<Box> boxes(panoptic.segments.size());
  for (int y = 0; y < panoptic.runs.rows(); ++y) {
    for (const SegmentRun& run : panoptic.runs.row(y)) {
      if (run.segment != 0) boxes[run.segment - 1u].include(run, y);
    }
  }
  return boxes;
}

/// Gives every part a number of its own.
void replace_by_parts(const std::vector<Box>& boxes, const std::vector<Parts>& parts,
                      PanopticMap& panoptic) {
  std::vector<InputSegment> segments;
  std::vector<std::uint16_t> first{0};  // number of the first part, by number of the segment
  for (std::size_t k = 0; k < parts.size(); ++k) {
    first.push_back(static_cast<std::uint16_t>(segments.size() + 1));
    for (std::uint16_t p = 1; p <= parts[k].count; ++p) {
      segments.push_back(panoptic.segments[k]);
      if (parts[k].count > 1) segments.back().part = p;
    }
  }
  for (int y = 0; y < panoptic.runs.rows(); ++y) {
    std::uint16_t* row = panoptic.map.row(y);
    for (const SegmentRun& run : panoptic.runs.row(y)) {
      std::fill(row + run.x0, row + run.x1, first[run.segment]);
      if (run.segment == 0 || parts[run.segment - 1u].count == 1) continue;
      const Box& box = boxes[run.segment - 1u];
      const std::uint16_t* part = parts[run.segment - 1u].of_pixel.data() +
                                  static_cast<std::ptrdiff_t>(y - box.y0) * box.width() - box.x0;
      for (int x = run.x0; x < run.x1; ++x)
        row[x] = static_cast<std::uint16_t>(row[x] + part[x] - 1);
    }
  }
  panoptic.segments = std::move(segments);
  panoptic.runs = find_runs(panoptic.map);
}

}  // namespace

void split_by_depth(const ImageOf<float>& disparity, PanopticMap& panoptic) {
  if (panoptic.runs.empty()) panoptic.runs = find_runs(panoptic.map);
  const std::vector<SegmentShape> shapes = segment_shapes(panoptic.runs, panoptic.segments.size());
  const std::vector<Box> boxes = boxes_of(panoptic);
  std::vector<Parts> parts(panoptic.segments.size());
  std::size_t total = 0;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    if (panoptic.segments[k].thing && shapes[k].area >= 2 * kLeastArea) {
      parts[k] =
          SegmentSplit(disparity, panoptic.map, static_cast<std::uint16_t>(k + 1), boxes[k]).run();
    }
    total += parts[k].count;
  }
  if (total == parts.size() || total >= std::numeric_limits<std::uint16_t>::max()) return;
  replace_by_parts(boxes, parts, panoptic);
}

}  // namespace kys_slam
