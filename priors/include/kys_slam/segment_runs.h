// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

namespace kys_slam {

/// First x > begin at which a row of `width` numbers differs from its value at `begin`; `width` if
/// none.
template <typename T>
int run_end(const T* row, int begin, int width) {
  static_assert(std::is_unsigned_v<T> && sizeof(T) <= 4);
  // Eight bytes at a time.
  constexpr int kStep = 8 / sizeof(T);
  constexpr std::uint64_t kRepeat = ~std::uint64_t{0} / std::numeric_limits<T>::max();
  const std::uint64_t same = row[begin] * kRepeat;
  int x = begin + 1;
  for (std::uint64_t next = 0; x + kStep <= width; x += kStep) {
    std::memcpy(&next, row + x, sizeof next);
    if (next != same) break;
  }
  while (x < width && row[x] == row[begin]) ++x;
  return x;
}

/// Pixels x0 <= x < x1 of one row that belong to one segment.
struct SegmentRun {
  std::uint16_t x0 = 0;
  std::uint16_t x1 = 0;
  std::uint16_t segment = 0;  ///< 0 void
};

/// All runs of a segment map, row by row: row y has the runs row_begin[y]..row_begin[y+1]-1.
struct SegmentRuns {
  std::vector<SegmentRun> runs;
  std::vector<std::uint32_t> row_begin;

  [[nodiscard]] bool empty() const { return row_begin.empty(); }
  [[nodiscard]] int rows() const { return static_cast<int>(row_begin.size()) - 1; }
  [[nodiscard]] std::span<const SegmentRun> row(int y) const {
    const auto at = static_cast<std::size_t>(y);
    return {runs.data() + row_begin[at], runs.data() + row_begin[at + 1]};
  }
};

SegmentRuns find_runs(const ImageOf<std::uint16_t>& map);

}  // namespace kys_slam
