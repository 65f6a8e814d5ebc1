// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/stereo_camera.h>

#include <cstddef>
#include <string>

namespace kys_slam {

/// Result of check_stereo_pair(): what the matches of a pair show about its rectification.
struct PairCheck {
  static constexpr std::size_t kMinMatches = 30;  ///< matches; with fewer, `problem` is ""

  std::size_t matches = 0;      ///< features matched between the images, rows not compared
  double row_offset = 0;        ///< px, median of right row - left row
  double row_spread = 0;        ///< px, median absolute deviation from row_offset
  double backward_share = 0;    ///< share of matches with a disparity below -2 px, 0..1
  double median_disparity = 0;  ///< px
  /// One sentence about what is wrong: the pair is swapped, or not rectified (rows differ by more
  /// than 1.5 px). "" when nothing is wrong.
  std::string problem;
};

/// Matches two 8-bit images that should be a rectified pair of equal size. Takes about 20 ms.
PairCheck check_stereo_pair(const GrayImage& left, const GrayImage& right);

}  // namespace kys_slam
