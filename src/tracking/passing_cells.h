// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>

#include <cstdint>
#include <vector>

#include "tracking/tracking_context.h"

namespace kys_slam {

/// Cells of the image in which something flows by although the camera stands by its pose, row-major
/// and ascending; empty: none, or the pose says that the camera moves.
///
/// Compares the last frame with a frame that has a pose. Where nothing is nearer than the inliers,
/// a camera that moves them by less than a pixel moves nothing by several: no depth is needed. So
/// this takes corners without a disparity too, where find_other_motion() finds too few with one. In
/// cells with features and without inliers the features of the last frame are searched again; a
/// cell flows by when several of them agree in their shift and fewer keep their place. Cells do not
/// count when most of them lie in front of what the pose explains beside them: so do objects.
/// \param ignored per cell, 1: takes no part; empty: all take part
std::vector<std::size_t> find_passing_cells(const TrackingContext& context,
                                            const TrackedFrame& frame,
                                            const std::vector<std::uint8_t>& ignored,
                                            kys::Statistics& statistics);

}  // namespace kys_slam
