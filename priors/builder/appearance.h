#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

#include "priors/builder/depth.h"
#include "priors/builder/detection.h"
#include "priors/builder/ego_motion.h"
#include "priors/builder/panoptic.h"

namespace kys_slam {

/// Which of two flows the next image confirms, for every thing segment: that of a static scene or
/// the observed one. Corner-like patches of 7x7 px are compared by normalised correlation where
/// either flow puts them, up to 2 px around. Optical flow is often wrong in a consistent way where
/// images differ much (near things, things behind a pole); what stands still then still looks the
/// same where the static flow puts it.
/// \param is_stuff by segment number. \return by segment number.
std::vector<AppearanceEvidence> compare_appearance(const GrayImage& now, const GrayImage& next,
                                                   const EgoMotion& motion, const FlowField& flow,
                                                   const ImageOf<float>& disparity,
                                                   const InverseDepth& inverse_depth,
                                                   const SegmentRuns& runs,
                                                   const std::vector<std::uint8_t>& is_stuff);

}  // namespace kys_slam
