// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker_options.h"

namespace kys_slam {

void describe(kys::OptionList& list, TrackerOptions& o) {
  list.add("tracking.min_start_points", o.min_start_points, {10, 60000}, "",
           "stereo points to start a map");
  list.add("tracking.close_baselines", o.close_baselines, {1, 1e6}, "baselines",
           "points nearer than this are close: stereo alone gives an accurate position");
  list.add("tracking.motion_radius", o.motion_radius, {0.5, 1000}, "px",
           "search radius around a prediction by constant velocity, octave 0");
  list.add("tracking.min_motion_matches", o.min_motion_matches, {3, 60000}, "",
           "matches below which the radius is doubled, then the prediction is dropped");
  list.add("tracking.min_reference_matches", o.min_reference_matches, {3, 60000}, "",
           "matches with the reference keyframe below which a frame is lost");
  list.add("tracking.min_pose_inliers", o.min_pose_inliers, {3, 60000}, "",
           "inliers of a predicted pose below which it is dropped");
  list.add("tracking.min_local_inliers", o.min_local_inliers, {3, 60000}, "",
           "inliers with the local map below which a frame is lost");
  list.add("tracking.min_predicted_inliers", o.min_predicted_inliers, {3, 60000}, "",
           "the same for a pose predicted by constant velocity (tracking.acceleration > 0)");
  list.add("tracking.local_radius", o.local_radius, {0.1, 100}, "",
           "factor on the search radius of local landmarks (2.5 or 4 px, octave 0)");
  list.add("tracking.local_ratio", o.local_ratio, {0.1, 10}, "", "best over second best distance");
  list.add("tracking.max_distance", o.max_distance, {1, 1e6}, "bits",
           "largest distance of a match");
  list.add("tracking.reference_distance", o.reference_distance, {1, 1e6}, "bits",
           "largest distance of a match without prediction");
  list.add("tracking.reference_ratio", o.reference_ratio, {0.1, 10}, "",
           "best over second best distance without prediction");
  list.add("tracking.align", o.align,
           "keypoints are aligned with the image patches of their landmarks");
  list.add("tracking.landmark_noise", o.landmark_noise, {0, 100}, "",
           "variance that a landmark of one observation adds to a keypoint's (n: the n-th part)");
  list.add("tracking.max_relative_sigma", o.max_relative_sigma, {0, 1e6}, "",
           "uncertainty of the position, as a part of that of the expected one, above which the "
           "expected pose holds a frame");
  list.add("tracking.max_instance_evidence", o.max_instance_evidence, {0, 100}, "nats",
           "limit of what the belief about one instance says about a pose");
  list.add("tracking.prior_gap", o.prior_gap, {0, 60}, "s",
           "after a frame with priors in which one without starts no sub-map (mode verified)");
  describe(list, o.motion);
  describe(list, o.judge);
  describe(list, o.consensus);
  describe(list, o.keyframes);
  describe(list, o.integrity);
  describe(list, o.instances);
}

}  // namespace kys_slam
