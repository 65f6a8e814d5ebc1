#pragma once

#include <kys_slam/image.h>

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
  int min_threshold = 7;  ///< grey levels, used in cells where the first finds nothing
  int margin = 19;        ///< px without corners along the border, at least 4
  int cell = 35;          ///< px, about the side of a cell
};

/// FAST-9/16 corners with 3x3 non-maximum suppression and two thresholds (ORB-SLAM): cells in which
/// a corner reaches `threshold` keep such corners alone, the others those of `min_threshold`. One
/// pass over the image serves both. Of equal neighbours the first in reading order wins.
class CornerDetector {
 public:
  /// Fills `corners`, ordered by row, then column. The image's sides are below 32768.
  void detect(const GrayImage& image, const CornerOptions& options, std::vector<Corner>& corners);

 private:
  struct ScoreRow {
    std::vector<std::uint8_t> scores;  // with kPad zeros before and after whole groups
    std::vector<std::uint8_t> groups;  // whether a group has a score
  };

  void resize(std::size_t groups);
  void collect(const GrayImage& image, const CornerOptions& options, int y, const ScoreRow& above,
               const ScoreRow& row, const ScoreRow& below);

  ScoreRow rows_[3];
  std::vector<Corner> found_;
  std::vector<std::uint8_t> strong_;     // per cell: a corner reaches the threshold
  std::vector<std::int32_t> column_of_;  // cell column by x
};

/// FAST-9/16 score of every pixel: the largest threshold t at which nine contiguous pixels of the
/// circle of radius 3 are all brighter than the centre by more than t, or all darker; 0 where it is
/// no corner at `min_threshold`, and in the outer `margin` (at least 3) pixels.
GrayImage fast_score_map(const GrayImage& image, int min_threshold, int margin);

}  // namespace kys_slam
