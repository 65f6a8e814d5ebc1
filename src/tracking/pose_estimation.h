// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "matching/landmark_search.h"
#include "tracking/pose_candidate.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// A feature as an observation of a landmark with that many observers; includes the noise of the
/// landmark's position.
[[nodiscard]] StereoPixel pixel_of(const TrackingContext& context, const FrameFeatures& features,
                                   std::size_t feature, std::size_t observers);
[[nodiscard]] PoseObservation observation_of(const TrackingContext& context,
                                             const FrameFeatures& features, std::size_t feature,
                                             const Eigen::Vector3d& p_w, std::size_t observers);

/// Gives features the landmarks that were searched for, one per match; returns how many.
int assign_matches(std::span<const SearchMatch> matches, std::span<const LandmarkId> wanted,
                   std::vector<LandmarkId>& landmarks);

/// Pose of a candidate from its landmarks, beginning with its pose; outliers lose their landmark.
/// Sets its pose, prior, inliers and the evidence of them.
/// \param taken s, when the image was taken
/// \param expects false: the expected pose is not used
void estimate(const TrackingContext& context, const FrameFeatures& features, double taken,
              PoseCandidate& candidate, bool expects = true);

}  // namespace kys_slam
