#pragma once

#include <limits>

namespace kys_slam {

/// Observation of a point in a rectified stereo pair.
struct StereoPixel {
  float u = 0;                                              ///< px, left image
  float v = 0;                                              ///< px
  float u_right = std::numeric_limits<float>::quiet_NaN();  ///< px; NaN: left image only
  float inv_sigma = 1;                                      ///< 1/px
};

}  // namespace kys_slam
