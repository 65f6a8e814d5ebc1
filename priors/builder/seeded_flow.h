// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include "priors/fusion/depth.h"
#include "priors/fusion/ego_motion.h"
#include "priors/fusion/options.h"

namespace kys_slam {

/// Disparity (px) with every gap of a row filled with the smaller disparity of its two ends, as
/// behind an occluding edge. Rows without any disparity get `least` px.
ImageOf<float> fill_disparity(const ImageOf<float>& disparity, float least);

/// The flow (px) of a static scene with these disparities. 0 where it is not defined (behind the
/// camera) or longer than `limit` px.
FlowField static_flow(const EgoMotion& motion, const InverseDepth& inverse_depth,
                      const ImageOf<float>& disparity, float limit);

/// The backward flow (px) at the end points of `forward`. Of two pixels with the same end point the
/// nearer one (larger disparity) is used. Gaps get the flow of the farther of their two ends.
FlowField reverse_flow(const FlowField& forward, const ImageOf<float>& disparity);

/// Dense inverse search flow from `now` to `next`, px, with the forward-backward check of the
/// options. With flow_estimate.seeded the search also starts from the flow of the static scene: the
/// motion of the camera is fitted to a flow at a quarter of the size, depth comes from `disparity`
/// (if empty, not seeded).
FlowField estimate_checked_flow(const BuilderOptions& options, const StereoCamera& camera,
                                const GrayImage& now, const GrayImage& next,
                                const ImageOf<float>& disparity,
                                const ImageOf<std::uint16_t>& segment_map,
                                const std::vector<std::uint8_t>& is_stuff);

}  // namespace kys_slam
