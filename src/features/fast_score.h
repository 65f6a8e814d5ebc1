#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// FAST-9/16 score of every pixel: the largest threshold t at which nine contiguous pixels of the
/// circle of radius 3 are all brighter than the centre by more than t, or all darker; 0 where it
/// is no corner at `min_threshold`. The outer `margin` (at least 3) pixels are left 0.
/// `score` takes the size of the image.
void fast_score_map(const GrayImage& image, int min_threshold, int margin, GrayImage& score);

struct Corner {
  std::int16_t x = 0;  ///< px of its level
  std::int16_t y = 0;
  std::uint8_t score = 0;
};

/// Local maxima (3x3) of the score map inside the margin. Cells of about `cell` px in which a corner
/// reaches `threshold` keep such corners alone; the others keep all they have. Ordered by row, then
/// column.
void select_corners(const GrayImage& score, int threshold, int margin, int cell,
                    std::vector<Corner>& corners);

}  // namespace kys_slam
