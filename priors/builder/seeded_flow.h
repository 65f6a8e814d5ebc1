#pragma once

#include <kys_slam/image.h>

#include "priors/builder/depth.h"
#include "priors/builder/ego_motion.h"
#include "priors/builder/options.h"

namespace kys_slam {

/// Disparity (px) with every gap of a row filled by the farther of its two sides, as behind an
/// occluding edge; rows without any get `least` px.
ImageOf<float> fill_disparity(const ImageOf<float>& disparity, float least);

/// The flow (px) that a static scene of these disparities has. 0 where it has none (behind the
/// camera, or beyond `limit` px).
FlowField static_flow(const EgoMotion& motion, const InverseDepth& inverse_depth,
                      const ImageOf<float>& disparity, float limit);

/// The flow back, from where the pixels of `forward` end: of two that end at one place the nearer
/// (larger disparity) counts; where none ends the gap is filled by the farther of its two sides.
FlowField reverse_flow(const FlowField& forward, const ImageOf<float>& disparity);

/// Dense inverse search flow from `now` to `next`, px, with the forward-backward check of the
/// options. With flow_estimate.seeded the search also starts from the flow that the static scene
/// has: the camera's motion comes from a flow at a quarter of the size, depth from `disparity`
/// (may be empty: not seeded).
FlowField estimate_checked_flow(const BuilderOptions& options, const StereoCamera& camera,
                                const GrayImage& now, const GrayImage& next,
                                const ImageOf<float>& disparity,
                                const ImageOf<std::uint16_t>& segment_map,
                                const std::vector<std::uint8_t>& is_stuff);

}  // namespace kys_slam
