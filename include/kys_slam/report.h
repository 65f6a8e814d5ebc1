// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

enum class FrameStatus : std::uint8_t {
  kStarted,  ///< first frame of a map
  kTracked,
  kLost,  ///< no pose; `reason` says why
};
const char* to_string(FrameStatus status);

/// How far the pose of a frame can be relied on.
enum class Integrity : std::uint8_t {
  kOk,
  kDegraded,      ///< little supports the pose
  kContradicted,  ///< something else in the image or in the motion contradicts the pose
};
const char* to_string(Integrity integrity);

/// Why the integrity of a frame is not kOk; the first that applies.
enum class IntegrityReason : std::uint8_t {
  kNone,
  kImpossibleMotion,  ///< contradicted: no camera accelerates like that
  kTwoMotions,        ///< contradicted: a large part of the image moves otherwise
  kOnlyObjects,       ///< degraded: only objects that can move support it
  kWeakGeometry,      ///< degraded: few or far points leave the position uncertain
  kFewPoints,         ///< degraded: few landmarks support it
  kManyOutliers,      ///< degraded: most matches disagree with it
  kHeld,              ///< degraded: it is held by constant velocity
};
/// A phrase for the user; "": kNone.
const char* to_string(IntegrityReason reason);

/// Result of loop closing for a keyframe.
enum class LoopEvent : std::uint8_t {
  kNone,
  kClosed,  ///< drift within a sub-map corrected
  kMerged,  ///< two sub-maps became one
};
const char* to_string(LoopEvent event);

/// Time of the stages of one frame, ms. `total` is the time from the frame to its pose: `feed`
/// without a requested stall (`control.stall_ms`) and, in the schedule `sequential`, without the
/// back end. Times of the back end are those of the keyframe made from this frame, in whichever
/// thread it ran.
struct StageTimes {
  double total = 0;
  double extract = 0;  ///< both images
  double priors = 0;   ///< prior look-up
  double stereo = 0;
  double track = 0;      ///< prediction, local map, keyframe decision, wait for the back end
  double predict = 0;    ///< part of track
  double local_map = 0;  ///< part of track
  double local_mapping = 0;
  double local_bundle = 0;  ///< part of local_mapping
  double loop = 0;
};

/// Pose of a frame relative to another frame, and how well it is known. The true pose is
/// T_other_c exp(d) with d = [w; v] of this covariance: w a rotation vector (rad), v a shift (m),
/// both in the frame of this frame's left camera. This is the convention of GTSAM's
/// BetweenFactor<Pose3>; ros_covariance.h converts to that of ROS. docs/pose_quality.md says what
/// it contains.
struct RelativePose {
  using Covariance = Eigen::Matrix<double, 6, 6>;
  std::int64_t other = -1;  ///< index of the other frame; -1: a keyframe of a loaded map
  Rigid3 T_other_c;
  Covariance covariance = Covariance::Zero();  ///< positive definite
};

/// Result of one frame.
struct FrameReport {
  std::int64_t index = 0;
  std::string name;
  double timestamp = 0;  ///< s
  FrameStatus status = FrameStatus::kLost;
  std::string reason;  ///< why the frame is lost, or how its pose was predicted
  /// What is wrong with an image or with the motion: a phrase that stays the same while the fault
  /// lasts. "": nothing.
  std::string warning;
  /// Of a frame with a pose. It says what the frame itself shows; drift is not seen by it.
  Integrity integrity = Integrity::kOk;
  IntegrityReason integrity_reason = IntegrityReason::kNone;
  bool relocalised = false;  ///< tracking failed, and relocalisation succeeded
  Rigid3 T_w_c;              ///< as estimated at this frame; undefined when lost
  /// Number of the sub-map in whose world frame T_w_c is, as known when tracked; -1: lost. The same
  /// numbers as FrameEstimate::submap.
  std::int64_t submap = -1;
  /// The same relative to the reference keyframe, to which its uncertainty refers; when tracked.
  std::optional<RelativePose> local;
  /// Relative to the last frame with a pose; when tracked, but not after a relocalisation. When
  /// optimisation has moved that frame since, it is not the quotient of the two T_w_c.
  std::optional<RelativePose> motion;
  int keypoints = 0;  ///< left image
  int stereo_matches = 0;
  int matches = 0;  ///< landmarks matched
  int inliers = 0;  ///< inliers of these after pose optimisation
  bool keyframe = false;
  LoopEvent loop = LoopEvent::kNone;
  std::int64_t loop_frame = -1;  ///< index of the earlier frame; -1: no loop
  double loop_distance_m = 0;    ///< m, between the two frames, as verified
  double loop_gap_m = 0;         ///< m, translation error before the correction
  double prior_coverage = 0;     ///< share of keypoints with a valid label, 0..1
  /// Index of the frame whose segments (System::add_segments) took effect with this one; -1: none.
  std::int64_t segments_of = -1;
  int masked = 0;  ///< keypoints dropped by masks or by mode `mask`
  kys::Statistics
      statistics;  ///< descriptor comparisons of this frame and of its keyframe in the back end
  StageTimes times;
  double resident_mb = 0;
};

/// Estimate of one frame; final after `System::finish`.
struct FrameEstimate {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  /// False: the frame is lost, or its sub-map is not connected to the one with most frames.
  bool connected = false;
  std::int64_t submap = -1;            ///< number of its sub-map, -1: lost
  Rigid3 T_w_c;                        ///< in the world frame of its sub-map; undefined when lost
  std::optional<RelativePose> local;   ///< that of FrameReport: as known when it was tracked
  std::optional<RelativePose> motion;  ///< the same
};

}  // namespace kys_slam
