// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>

#include <span>
#include <vector>

#include "map/frame_features.h"
#include "matching/stereo_matcher.h"

namespace kys_slam {

/// Rows of stereo matches in the right image, to a fraction of a pixel: the patch of the left
/// keypoint is aligned in both directions (Lucas and Kanade, 1981, with the affine motion of a
/// plane). A perfect pair has the row of the left image. Measured are corners with contrast in both
/// directions, of fine octaves, at most `most` of them, spread over the list of keypoints.
/// \param right both views with their pyramids
/// \param u_right columns from match_stereo(), px
/// \param rig tells where to begin
/// \return px, NaN where there is none
std::vector<float> measure_rows(const StereoView& left, const StereoView& right,
                                std::span<const float> u_right, const RigCorrection& rig,
                                std::size_t most);

}  // namespace kys_slam
