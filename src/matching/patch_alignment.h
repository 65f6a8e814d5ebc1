#pragma once

#include <kys_slam/image.h>

#include <Eigen/Core>
#include <optional>

namespace kys_slam {

/// Where a patch of the left image lies in the right one.
struct PatchAlignment {
  float column = 0;    ///< px, of the patch's centre
  float slant_u = 0;   ///< px of column per px along the row, beyond one
  float slant_v = 0;   ///< px of column per row
  float residual = 0;  ///< grey levels, weighted root mean square
};

/// Aligns the 11x11 patch centred on `at` (fractions of pixels count) with the same rows of the
/// right image, from `start` on and not beyond 1.5 px from it: least squares of the grey
/// differences with their mean removed, over the column of the centre and how it changes along the
/// rows and from row to row (Lucas-Kanade with the affine motion that a plane seen by a rectified
/// pair can have). A road seen at a grazing angle has a third of a pixel of disparity per row: a
/// patch that stays upright takes the disparity of wherever its contrast is, not of its centre.
/// Pixels count the less the further from the centre they are, and the less they fit, as those of
/// another surface. Gradients are those of the left patch, so that the noise of the right one,
/// which is looked up between its pixels, cannot pull the result.
/// \return nothing without contrast, close to the border, or when it strays.
std::optional<PatchAlignment> align_patch(const GrayImage& left, const GrayImage& right,
                                          const Eigen::Vector2f& at, float start);

}  // namespace kys_slam
