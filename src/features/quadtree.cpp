#include "features/quadtree.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kys_slam {

namespace {

struct Cell {
  float x0, x1, y0, y1;     // px
  std::size_t first, last;  // its corners, a range of `order`
  [[nodiscard]] std::size_t count() const { return last - first; }
};

class Quadtree {
 public:
  explicit Quadtree(const std::vector<Corner>& corners) : corners_(corners) {
    order_.resize(corners.size());
    scratch_.resize(corners.size());
  }

  /// Puts the corners into columns of equal width, the first cells.
  void start(int min_x, int max_x, int min_y, int max_y) {
    const auto width = static_cast<float>(max_x - min_x);
    const auto height = static_cast<float>(max_y - min_y);
    const int columns = std::max(1, static_cast<int>(std::lround(width / height)));
    const float step = width / static_cast<float>(columns);
    std::size_t filled = 0;
    for (int c = 0; c < columns; ++c) {
      Cell cell{static_cast<float>(min_x) + static_cast<float>(c) * step,
                static_cast<float>(min_x) + static_cast<float>(c + 1) * step,
                static_cast<float>(min_y),
                static_cast<float>(max_y),
                filled,
                filled};
      for (std::size_t i = 0; i < corners_.size(); ++i) {
        const int column =
            std::clamp(static_cast<int>(
                           (static_cast<float>(corners_[i].x) - static_cast<float>(min_x)) / step),
                       0, columns - 1);
        if (column == c) order_[cell.last++] = static_cast<std::uint32_t>(i);
      }
      filled = cell.last;
      if (cell.count() > 0) cells_.push_back(cell);
    }
  }

  void grow(std::size_t wanted) {
    while (cells_.size() < wanted) {
      std::vector<std::size_t> splittable;
      for (std::size_t c = 0; c < cells_.size(); ++c) {
        if (cells_[c].count() > 1) splittable.push_back(c);
      }
      if (splittable.empty()) return;
      const bool last_round = cells_.size() + 3 * splittable.size() > wanted;
      if (last_round) {
        // Not all can be split any more: the fullest first.
        std::stable_sort(splittable.begin(), splittable.end(), [&](std::size_t a, std::size_t b) {
          return cells_[a].count() > cells_[b].count();
        });
      }
      const std::size_t before = cells_.size();
      for (const std::size_t c : splittable) {
        split(c);
        if (last_round && cells_.size() >= wanted) return;
      }
      // Cells that shrink without dividing go on until they hold one place.
      if (cells_.size() == before && all_at_one_place()) return;
    }
  }

  [[nodiscard]] std::vector<Corner> best() const {
    std::vector<Corner> kept;
    kept.reserve(cells_.size());
    for (const Cell& cell : cells_) {
      std::uint32_t chosen = order_[cell.first];
      for (std::size_t k = cell.first; k < cell.last; ++k) {
        const Corner& candidate = corners_[order_[k]];
        const Corner& leader = corners_[chosen];
        if (candidate.score > leader.score ||
            (candidate.score == leader.score && order_[k] < chosen)) {
          chosen = order_[k];
        }
      }
      kept.push_back(corners_[chosen]);
    }
    return kept;
  }

 private:
  void split(std::size_t index) {
    const Cell cell = cells_[index];
    const float mx = 0.5f * (cell.x0 + cell.x1);
    const float my = 0.5f * (cell.y0 + cell.y1);
    const auto quarter = [&](std::uint32_t i) {
      const Corner& c = corners_[i];
      return (static_cast<float>(c.x) >= mx ? 1u : 0u) + (static_cast<float>(c.y) >= my ? 2u : 0u);
    };
    std::array<std::size_t, 5> start{};
    for (std::size_t k = cell.first; k < cell.last; ++k) ++start[quarter(order_[k]) + 1];
    for (std::size_t q = 1; q < 5; ++q) start[q] += start[q - 1];
    std::array<std::size_t, 4> next{start[0], start[1], start[2], start[3]};
    for (std::size_t k = cell.first; k < cell.last; ++k) {
      scratch_[next[quarter(order_[k])]++] = order_[k];
    }
    std::copy_n(scratch_.begin(), cell.count(),
                order_.begin() + static_cast<std::ptrdiff_t>(cell.first));
    bool placed = false;
    for (std::size_t q = 0; q < 4; ++q) {
      if (start[q + 1] == start[q]) continue;
      Cell child{(q & 1) != 0 ? mx : cell.x0, (q & 1) != 0 ? cell.x1 : mx,
                 (q & 2) != 0 ? my : cell.y0, (q & 2) != 0 ? cell.y1 : my,
                 cell.first + start[q],       cell.first + start[q + 1]};
      if (!placed) {
        cells_[index] = child;
      } else {
        cells_.push_back(child);
      }
      placed = true;
    }
  }

  [[nodiscard]] bool all_at_one_place() const {
    return std::all_of(cells_.begin(), cells_.end(), [](const Cell& c) {
      return c.count() <= 1 || (c.x1 - c.x0 < 0.5f && c.y1 - c.y0 < 0.5f);
    });
  }

  const std::vector<Corner>& corners_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> scratch_;
  std::vector<Cell> cells_;
};

}  // namespace

std::vector<Corner> distribute(const std::vector<Corner>& corners, int min_x, int max_x, int min_y,
                               int max_y, int wanted) {
  if (corners.empty() || wanted <= 0 || max_x <= min_x || max_y <= min_y) return {};
  Quadtree tree(corners);
  tree.start(min_x, max_x, min_y, max_y);
  tree.grow(static_cast<std::size_t>(wanted));
  return tree.best();
}

}  // namespace kys_slam
