// SPDX-License-Identifier: BSD-3-Clause
#include "features/quadtree.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

namespace kys_slam {

namespace {

constexpr int kDepth = 12;  // how often a root can be split
constexpr int kMaxRoots = 255;

/// A corner's path through the tree: the root, then two bits per split (lower half, right half).
/// Corners in the order of their keys lie node by node, at every depth.
struct Entry {
  std::uint32_t key;
  Corner corner;
};

std::uint32_t spread_bits(std::uint32_t v) {  // bit i to bit 2 i, for 16 bits
  v = (v | v << 8) & 0x00FF00FFu;
  v = (v | v << 4) & 0x0F0F0F0Fu;
  v = (v | v << 2) & 0x33333333u;
  return (v | v << 1) & 0x55555555u;
}

/// Place of `at` within [0, extent) in steps of extent / steps.
std::uint32_t step_of(int at, int extent, int steps) {
  return static_cast<std::uint32_t>(static_cast<std::int64_t>(at) * steps / extent);
}

/// Puts the entries in the order of the leading bits of their keys, which are below `end`, in one
/// pass. Those that share them come in any order. Returns the number of the bits below.
int sort_by_key(std::vector<Entry>& entries, std::uint32_t end) {
  constexpr int kBits = 11;
  const int shift = std::max(0, static_cast<int>(std::bit_width(end - 1)) - kBits);
  std::array<std::uint32_t, (1u << kBits) + 1> start{};
  for (const Entry& e : entries) ++start[(e.key >> shift) + 1];
  std::uint32_t sum = 0;
  for (std::uint32_t& s : start) s = sum += s;
  std::vector<Entry> other(entries.size());
  for (const Entry& e : entries) other[start[e.key >> shift]++] = e;
  entries.swap(other);
  return shift;
}

class Quadtree {
 public:
  Quadtree(const std::vector<Corner>& corners, int min_x, int max_x, int min_y, int max_y) {
    const int width = max_x - min_x;
    const int height = max_y - min_y;
    const int roots = std::clamp(static_cast<int>(std::lround(static_cast<double>(width) / height)),
                                 1, kMaxRoots);
    constexpr int kSteps = 1 << kDepth;
    // Of every column the root and its part of the path, of every row its part: corners share them.
    std::vector<std::uint32_t> column(static_cast<std::size_t>(width));
    for (int x = 0; x < width; ++x) {
      const std::uint32_t step = step_of(x, width, roots * kSteps);
      column[static_cast<std::size_t>(x)] =
          (step / kSteps) << (2 * kDepth) | spread_bits(step % kSteps);
    }
    std::vector<std::uint32_t> row(static_cast<std::size_t>(height));
    for (int y = 0; y < height; ++y) {
      row[static_cast<std::size_t>(y)] = spread_bits(step_of(y, height, kSteps)) << 1;
    }
    const auto part = [](const std::vector<std::uint32_t>& parts, int at) {
      return parts[static_cast<std::size_t>(std::clamp(at, 0, static_cast<int>(parts.size()) - 1))];
    };
    entries_.reserve(corners.size());
    for (const Corner& c : corners) {
      const std::uint32_t key = part(column, c.x - min_x) | part(row, c.y - min_y);
      entries_.push_back({key, c});
    }
    unsorted_bits_ = sort_by_key(entries_, static_cast<std::uint32_t>(roots) << (2 * kDepth));
    std::uint32_t first = 0;
    for (std::uint32_t root = 0; root < static_cast<std::uint32_t>(roots); ++root) {
      first = add({first, static_cast<std::uint32_t>(entries_.size()), -1, false}, root + 1,
                  2 * kDepth);
    }
  }

  void grow(std::size_t wanted) {
    while (nodes_.size() < wanted) {
      std::vector<std::uint32_t> splittable;
      for (std::uint32_t n = 0; n < nodes_.size(); ++n) {
        if (nodes_[n].count() > 1 && nodes_[n].depth < kDepth) splittable.push_back(n);
      }
      if (splittable.empty()) return;
      const bool last_round = nodes_.size() + 3 * splittable.size() > wanted;
      if (last_round) {
        // Not all can be split any more: the fullest first, in reading order of the tree.
        std::sort(splittable.begin(), splittable.end(), [&](std::uint32_t a, std::uint32_t b) {
          const Node& l = nodes_[a];
          const Node& r = nodes_[b];
          return l.count() != r.count() ? l.count() > r.count() : l.first < r.first;
        });
      }
      for (const std::uint32_t n : splittable) {
        split(n);
        if (last_round && nodes_.size() >= wanted) return;
      }
    }
  }

  /// The strongest corner of each node, of equal ones the first in reading order.
  [[nodiscard]] std::vector<Corner> best() {
    std::sort(nodes_.begin(), nodes_.end(),
              [](const Node& a, const Node& b) { return a.first < b.first; });
    std::vector<Corner> kept;
    kept.reserve(nodes_.size());
    for (const Node& node : nodes_) {
      Corner best = entries_[node.first].corner;
      for (std::uint32_t k = node.first + 1; k < node.last; ++k) {
        const Corner& c = entries_[k].corner;
        if (c.score != best.score ? c.score > best.score
                                  : (c.y != best.y ? c.y < best.y : c.x < best.x)) {
          best = c;
        }
      }
      kept.push_back(best);
    }
    return kept;
  }

 private:
  struct Node {
    std::uint32_t first, last;  // range of entries_
    int depth;                  // splits below the root
    bool sorted;                // by the whole key, not by its leading bits alone

    [[nodiscard]] std::uint32_t count() const { return last - first; }
  };

  /// Adds the child of `parent` made of the entries from parent.first whose key, from bit `shift`
  /// on, is below `end`, if there are any. Returns where the next child begins.
  std::uint32_t add(const Node& parent, std::uint32_t end, int shift) {
    const auto from = entries_.begin() + parent.first;
    const auto to = entries_.begin() + parent.last;
    const auto last = std::partition_point(
        from, to, [end, shift](const Entry& e) { return e.key >> shift < end; });
    const auto at = static_cast<std::uint32_t>(last - entries_.begin());
    if (at > parent.first) nodes_.push_back({parent.first, at, parent.depth + 1, parent.sorted});
    return at;
  }

  void split(std::uint32_t index) {
    Node rest = nodes_[index];
    const int shift = 2 * (kDepth - 1 - rest.depth);
    if (shift < unsorted_bits_ && !rest.sorted) {  // few nodes are split so far
      std::sort(entries_.begin() + rest.first, entries_.begin() + rest.last,
                [](const Entry& a, const Entry& b) { return a.key < b.key; });
      rest.sorted = true;
    }
    const std::uint32_t path = entries_[rest.first].key >> shift & ~3u;
    for (std::uint32_t quarter = 1; quarter <= 4; ++quarter) {
      rest.first = add(rest, path + quarter, shift);
    }
    nodes_[index] = nodes_.back();  // there is at least one child
    nodes_.pop_back();
  }

  std::vector<Entry> entries_;
  int unsorted_bits_ = 0;  // below those that the entries are in order of
  std::vector<Node> nodes_;
};

}  // namespace

std::vector<Corner> distribute(const std::vector<Corner>& corners, int min_x, int max_x, int min_y,
                               int max_y, int wanted) {
  if (corners.empty() || wanted <= 0 || max_x <= min_x || max_y <= min_y) return {};
  Quadtree tree(corners, min_x, max_x, min_y, max_y);
  tree.grow(static_cast<std::size_t>(wanted));
  return tree.best();
}

}  // namespace kys_slam
