// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

#include "priors/fusion/depth.h"
#include "priors/fusion/detection.h"
#include "priors/fusion/ego_motion.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// For every thing segment: which of two flows the next image confirms, the flow of a static scene
/// or the observed flow. Patches of 7x7 px at corners are compared by normalised correlation at the
/// end of either flow, within 2 px. Optical flow is often consistently wrong where images differ
/// much (near objects, objects behind a pole). A static object still matches at the end of the
/// static flow.
/// \param is_stuff by segment number
/// \return by segment number
std::vector<AppearanceEvidence> compare_appearance(const GrayImage& now, const GrayImage& next,
                                                   const EgoMotion& motion, const FlowField& flow,
                                                   const ImageOf<float>& disparity,
                                                   const InverseDepth& inverse_depth,
                                                   const SegmentRuns& runs,
                                                   const std::vector<std::uint8_t>& is_stuff);

}  // namespace kys_slam
