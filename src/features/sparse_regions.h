#pragma once

#include <cstdint>
#include <vector>

namespace kys_slam {

/// Regions of an image that need few keypoints, on a grid of square cells: things that move hold no
/// pose.
struct SparseRegions {
  int step = 0;     ///< px, side of a cell
  int columns = 0;  ///< cells per row
  std::vector<std::int32_t>
      region;  ///< per cell: number of its region, -1: none; empty: no regions

  [[nodiscard]] bool empty() const { return region.empty(); }
  /// Of a pixel; -1: none.
  [[nodiscard]] std::int32_t at(int x, int y) const {
    return x < 0 || y < 0 ? -1 : of_cell(x / step, y / step);
  }
  /// Whether the cells around a pixel, up to `cells` away, are of its region. Keypoints elsewhere
  /// show in part what is behind or before the thing.
  [[nodiscard]] bool is_interior(int x, int y, int cells) const {
    const std::int32_t own = at(x, y);
    for (int v = y / step - cells; v <= y / step + cells; ++v) {
      for (int u = x / step - cells; u <= x / step + cells; ++u) {
        if (of_cell(u, v) != own) return false;
      }
    }
    return true;
  }

 private:
  [[nodiscard]] std::int32_t of_cell(int u, int v) const {
    if (u < 0 || u >= columns || v < 0) return -1;
    const auto cell = static_cast<std::size_t>(v) * static_cast<std::size_t>(columns) +
                      static_cast<std::size_t>(u);
    return cell < region.size() ? region[cell] : -1;
  }
};

}  // namespace kys_slam
