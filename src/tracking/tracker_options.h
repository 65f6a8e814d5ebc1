// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include "motion/instance_tracker.h"
#include "optimization/pose_consensus.h"
#include "tracking/integrity_options.h"
#include "tracking/judge_options.h"
#include "tracking/keyframe_policy.h"
#include "tracking/motion_model.h"

namespace kys_slam {

struct TrackerOptions {
  int min_start_points = 100;   ///< stereo points needed to start a map
  double close_baselines = 40;  ///< points nearer than this many baselines are close
  float motion_radius = 7;      ///< px at octave 0, search around the predicted pixel
  /// with fewer, the radius is doubled, then the prediction is dropped
  int min_motion_matches = 10;
  int min_reference_matches = 15;
  int min_pose_inliers = 10;       ///< after the first pose of a frame
  int min_local_inliers = 30;      ///< after the local map; with fewer, lost
  int min_predicted_inliers = 15;  ///< the same for a pose predicted by constant velocity
  float local_radius = 1;          ///< factor on the search radius of local landmarks
  float local_ratio = 0.8f;        ///< best / second best
  float max_distance = 100;        ///< bits
  float reference_distance = 50;   ///< bits, matching without prediction
  float reference_ratio = 0.7f;
  bool align = true;  ///< align keypoints with the patches of their landmarks, if there are images
  /// Variance that a landmark of one observation adds to that of a keypoint; n observations add the
  /// n-th part. Between 0.04 (v), 0.36 (u) and 0.77 (disparity) for aligned keypoints of a rendered
  /// block, more on KITTI.
  double landmark_noise = 0.5;
  /// The expected pose is used as a prior when the position from the observations is more uncertain
  /// than this share of the uncertainty of the expected position.
  double max_relative_sigma = 0.5;
  double max_instance_evidence =
      3;                 ///< nats, limit of what one instance says: its belief may be wrong
  double prior_gap = 1;  ///< s after a frame with priors in which one without starts no sub-map
  MotionModelOptions motion;
  JudgeOptions judge;
  IntegrityOptions integrity;
  ConsensusOptions consensus;  ///< pose by image area, not by number of matches
  KeyFramePolicyOptions keyframes;
  InstanceTrackerOptions instances;  ///< used when the model uses belief
};
/// For check_options().
void describe(kys::OptionList& list, TrackerOptions& options);

}  // namespace kys_slam
