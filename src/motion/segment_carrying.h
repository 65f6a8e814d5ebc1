// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>

#include "map/frame_features.h"

/// What the parts of SegmentCarrier share.
namespace kys_slam::carrying {

inline constexpr double kFar = 1000;               // m, of features without a disparity
inline constexpr double kSurfaceTolerance = 0.25;  // of the disparity: still the same surface
inline constexpr double kLeastTolerance = 1.5;     // px
inline constexpr double kSurfaceRadius =
    0.03;                                // of the width: features that say how far a pixel is
inline constexpr double kNearest = 0.1;  // m
inline constexpr int kOctaves = 255;
inline constexpr int kCell = 4;  // px, side

/// px; surfaces whose disparities differ by less are the same.
inline double tolerance(double disparity) {
  return std::max(kLeastTolerance, kSurfaceTolerance * disparity);
}

inline double disparity_of(const FrameFeatures& features, std::size_t i) {
  return features.keypoint(i).x - features.u_right(i);
}

}  // namespace kys_slam::carrying
