#pragma once

#include <kys_slam/image.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <vector>

#include "priors/builder/detection.h"
#include "priors/builder/panoptic.h"

namespace kys_slam {

/// Was a thing where it is now at another time? Its pixels go to the other frame as a still scene's
/// do. Where that frame sees farther than the pixel is (px of disparity, with a margin for its
/// error), the place was free: the thing was not there. Where it sees the same depth the place was
/// occupied; where it sees something nearer, or nothing, it says nothing. Needs neither optical
/// flow nor keypoints on the thing, and hiding cannot be mistaken for moving. \param T_other_now
/// left camera  \param right the disparities are those of the right view \param disparity,other px,
/// NaN unknown. \param is_thing by segment number. \return by segment number
std::vector<FreeSpaceEvidence> compare_space(const StereoCamera& camera, const Rigid3& T_other_now,
                                             bool right, const ImageOf<float>& disparity,
                                             const ImageOf<float>& other, const SegmentRuns& runs,
                                             const std::vector<bool>& is_thing);

}  // namespace kys_slam
