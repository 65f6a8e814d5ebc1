// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <vector>

#include "priors/fusion/detection.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Was an object at its present position at another time? Its pixels are projected to the other
/// frame as static points. Where that frame measures a larger depth (disparity compared in px, with
/// a margin for its error), the position was free: the object was not there. Where it measures the
/// same depth, the position was occupied. Where it measures a smaller depth, or none, it gives no
/// evidence. The test needs neither optical flow nor keypoints on the object, and does not take
/// occlusion for motion.
/// \param T_other_now of the left camera
/// \param right true: the disparities are those of the right view
/// \param disparity,other px, NaN: not known
/// \param is_thing by segment number
/// \return by segment number
std::vector<FreeSpaceEvidence> compare_space(const StereoCamera& camera, const Rigid3& T_other_now,
                                             bool right, const ImageOf<float>& disparity,
                                             const ImageOf<float>& other, const SegmentRuns& runs,
                                             const std::vector<bool>& is_thing);

}  // namespace kys_slam
