// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include "priors/fusion/depth.h"

namespace kys_slam {

/// Left disparity (px, NaN where there is none) by semi-global matching. `right` false: of the left
/// view; true: of the right view, by matching the mirrored pair.
ImageOf<float> estimate_disparity(const GrayImage& left, const GrayImage& right_image, bool right);

/// Dense inverse search flow from one image to another, px. \param finest_level halvings of the
/// images on which it is refined last.  \param seed px; the search also starts from it, if given.
FlowField estimate_flow(const GrayImage& from, const GrayImage& to, int finest_level,
                        const FlowField* seed);

}  // namespace kys_slam
