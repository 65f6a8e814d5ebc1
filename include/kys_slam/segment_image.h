// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// The segmentation of the left image of one frame, as a network gives it.
struct SegmentImage {
  ImageOf<std::uint16_t> map;  ///< of the camera's size; 0: void, k: segments[k - 1]
  /// One per segment. `label`: dense index in the label space. `instance`: any number; the system
  /// finds identities over time itself. `unjudged`: whether the segment moves is not known.
  std::vector<kys::Prior> segments;
};

}  // namespace kys_slam
