// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tracking/pose_candidate.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// What the parts of the scene that cannot move say about a pose.
struct SceneSupport {
  int in_view = 0;     ///< points with a disparity or an inlier
  int inliers = 0;     ///< inliers away from the edges of objects
  int on_objects = 0;  ///< inliers on objects that can move

  [[nodiscard]] bool is_in_view(const SceneSupportOptions& options) const {
    return in_view >= options.in_view;
  }
  /// Where objects support a pose less than that, the fixed scene needs no more than they have.
  [[nodiscard]] bool is_enough(const SceneSupportOptions& options) const;
};

/// How much of the fixed scene and of objects is in view: all but `inliers`, which stays 0.
/// \param features of the frame
/// \param landmarks inliers, per feature; invalid: none
SceneSupport scene_in_view(const TrackingContext& context, const FrameFeatures& features,
                           const std::vector<LandmarkId>& landmarks);
/// The same with `inliers`, as far as the fixed scene is in view.
SceneSupport scene_support(const TrackingContext& context, const FrameFeatures& features,
                           const std::vector<LandmarkId>& landmarks);

}  // namespace kys_slam
