// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>

namespace kys_slam {

/// Information (inverse variance) of v and of the disparity relative to that of u.
struct InformationRatio {
  float v = 1;
  float disparity = 1;
};

/// Observation of a point in a rectified stereo pair.
struct StereoPixel {
  float u = 0;                                              ///< px, left image
  float v = 0;                                              ///< px
  float u_right = std::numeric_limits<float>::quiet_NaN();  ///< px; NaN: left image only
  float inv_sigma = 1;                                      ///< 1/px, of u
  InformationRatio ratio = {};
};

}  // namespace kys_slam
