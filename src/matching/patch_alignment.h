// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <Eigen/Core>
#include <optional>

namespace kys_slam {

/// Position of a patch of the left image in the right one.
struct PatchAlignment {
  float column = 0;    ///< px, of the patch's centre
  float slant_u = 0;   ///< px of column per px along the row, minus one
  float slant_v = 0;   ///< px of column per row
  float residual = 0;  ///< grey levels, weighted root mean square
};

/// Aligns the 11x11 px patch centred on `at` (sub-pixel) with the rows of the right image around
/// that of `start`, starting at its column, within 1.5 px. Least squares of the grey differences
/// with their mean removed, over the column of the centre and its slopes along and across the rows
/// (Lucas-Kanade with the affine motion of a plane in a rectified pair). Without slopes a patch of
/// a road, which has 0.3 px of disparity per row, gets the disparity of its contrast and not of its
/// centre. Weights fall with the distance from the centre and with the residual, for pixels of
/// another surface. Gradients are those of the left patch, so that interpolation noise of the right
/// image does not bias the result. \return nothing without contrast, close to the border, or when
/// it does not converge within 1.5 px
std::optional<PatchAlignment> align_patch(const GrayImage& left, const GrayImage& right,
                                          const Eigen::Vector2f& at, const Eigen::Vector2f& start);

}  // namespace kys_slam
