// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <Eigen/Core>

namespace kys_slam {

/// Whether all pixels within `reach` of a place, and one beyond, are in the image.
inline bool surrounds(const GrayImage& image, const Eigen::Vector2f& at, float reach) {
  // As floats: a conversion of what is far off or no number is not defined.
  return at.x() >= reach && at.y() >= reach &&
         at.x() + reach + 2 <= static_cast<float>(image.width()) &&
         at.y() + reach + 2 <= static_cast<float>(image.height());
}

}  // namespace kys_slam
