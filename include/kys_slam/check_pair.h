#pragma once

#include <kys_slam/image.h>
#include <kys_slam/stereo_camera.h>

#include <cstddef>
#include <string>

namespace kys_slam {

/// What the matches of a stereo pair say about how it was taken and calibrated.
struct PairCheck {
  static constexpr std::size_t kEnough = 30;  ///< matches; with fewer nothing is said

  std::size_t matches = 0;      ///< features found in both images, without looking at rows
  double row_offset = 0;        ///< px, median of right row - left row
  double row_spread = 0;        ///< px, median distance of a match's offset from it
  double backward_share = 0;    ///< of matches whose disparity is below -2 px
  double median_disparity = 0;  ///< px
  /// One sentence about what is wrong, or "" when nothing is: the pair is swapped, or not rectified
  /// (rows differ by more than 1.5 px).
  std::string problem;
};

/// Matches two images that should be a rectified pair. About 20 ms.
PairCheck check_stereo_pair(const GrayImage& left, const GrayImage& right);

}  // namespace kys_slam
