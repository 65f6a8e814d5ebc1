#pragma once

#include <kys_slam/image.h>

namespace kys_slam {

/// Which pixels of a frame not to use: 0 use, anything else not (instance numbers do). Keypoints
/// whose nearest pixel is masked are dropped after extraction, in every mode. Each is of the
/// rectified images' size or empty (use all).
struct StereoMasks {
  GrayImage left;
  GrayImage right;
};

}  // namespace kys_slam
