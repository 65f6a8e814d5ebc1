// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

namespace kys_slam {

/// Pixels of a frame that are not used: 0 means use, every other value (an instance number, for
/// example) means do not use. Keypoints whose nearest pixel is masked are dropped after extraction,
/// in every mode. Each mask has the size of the rectified images or is empty (use all pixels).
struct StereoMasks {
  GrayImage left;
  GrayImage right;
};

}  // namespace kys_slam
