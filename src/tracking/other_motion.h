// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>

#include <cstdint>
#include <vector>

#include "tracking/open_cells.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// What moves otherwise than the scene does under the pose of a frame.
struct OtherMotion {
  int explained = 0;               ///< cells of the image that the pose explains
  std::vector<std::size_t> cells;  ///< those that one other rigid motion explains; empty: none
  DepthOrder order;
  double shift = 0;       ///< px, mean shift in the image of the points that the other motion fits
  double pose_shift = 0;  ///< px, mean shift that the pose predicts for these points
};

/// Compares the last frame with a frame that has a pose. Cells of the image (ImageCells) with
/// stereo points and without inliers are not explained by the pose. Where they are many, their
/// points in the last frame are searched in the whole image by descriptor alone, and one rigid
/// motion that fits those that do not fit the pose is estimated (RANSAC over three points,
/// Fischler and Bolles 1981). What moves in front of the scene is nearer than the scene beside it
/// in the same rows of the image, and so is a pose contradicted by what is farther. Points on
/// objects that are believed to move take no part: they do not contradict a pose. \param ignored
/// per cell, 1: takes no part
OtherMotion find_other_motion(const TrackingContext& context, const TrackedFrame& frame,
                              const std::vector<std::uint8_t>& ignored,
                              kys::Statistics& statistics);

}  // namespace kys_slam
