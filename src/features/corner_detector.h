// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/image.h>

#include <array>
#include <cstdint>
#include <vector>

namespace kys_slam {

struct Corner {
  std::int16_t x = 0;  ///< px of its level
  std::int16_t y = 0;
  std::uint8_t score = 0;

  friend bool operator==(const Corner&, const Corner&) = default;
};

struct CornerOptions {
  int threshold = 20;     ///< grey levels
  int min_threshold = 7;  ///< grey levels, for cells without a corner at `threshold`
  int margin = 19;        ///< px without corners along the border, at least 4
  int cell = 35;          ///< px, about the side of a cell
};
/// For check_options().
void describe(kys::OptionList& list, CornerOptions& options);

/// FAST-9/16 corners with 3x3 non-maximum suppression and two thresholds (ORB-SLAM): cells with a
/// corner at `threshold` keep only such corners, other cells the corners at `min_threshold`. One
/// pass over the image computes both. Of equal neighbours the first in raster order is kept.
class CornerDetector {
 public:
  /// Replaces `corners`, ordered by row, then column. The sides of the image are below 32768 px.
  void detect(const GrayImage& image, const CornerOptions& options, std::vector<Corner>& corners);

  /// Sub-pixel offset (x, y), px, of a corner of the last detect(): the peak of the paraboloid
  /// fitted by least squares to its 3x3 scores; at most half a pixel.
  [[nodiscard]] std::array<float, 2> subpixel(const Corner& corner) const;

 private:
  [[nodiscard]] std::uint8_t* score_row(int y);
  void find_peaks(const CornerOptions& options, int width, int height, int y);
  void mark_weak_cells(std::size_t cell_row);
  void collect(const CornerOptions& options, int height, std::vector<Corner>& corners);

  // Rows from `origin_` on, each of whole groups with padding around them.
  std::vector<std::uint8_t> scores_;
  std::vector<std::uint8_t> groups_;  // per row: whether a group has a score
  std::size_t row_groups_ = 0;
  int origin_ = 0;  // px, image coordinate of the first row and column of scores_
  /// Peaks of one group, a bit per pixel.
  struct Peaks {
    std::uint64_t all = 0;
    std::uint64_t strong = 0;  // that reach the threshold
  };
  std::vector<Peaks> peaks_;  // as groups_
  std::size_t cell_columns_ = 0;
  std::size_t cell_rows_ = 0;
  std::vector<std::uint8_t> strong_;       // per cell: a corner reaches the threshold
  std::vector<std::uint32_t> column_of_;   // cell column by x - origin_; none outside the margin
  std::vector<std::size_t> column_begin_;  // the first x - origin_ of each, and one past the last
  std::vector<std::uint64_t> weak_cells_;  // of a row of cells, a bit per pixel: no corner does
};

/// FAST-9/16 score of every pixel: the largest threshold t at which nine contiguous pixels of the
/// circle of radius 3 are all brighter than the centre by more than t, or all darker; 0 where there
/// is no corner at `min_threshold`, and in the outer `margin` (at least 3) pixels.
GrayImage fast_score_map(const GrayImage& image, int min_threshold, int margin);

}  // namespace kys_slam
