// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

namespace kys_slam {

/// Whether two images of equal size are the same image, also when one was encoded again: at nearly
/// all corners the right image is the left one, with less than a quarter of a pixel of disparity
/// and no disparity in the median. A scene of which everything is further away than bf / 0.1 px
/// cannot be distinguished from this, nor be measured. False for images with few corners.
bool is_same_image(const GrayImage& left, const GrayImage& right);

}  // namespace kys_slam
