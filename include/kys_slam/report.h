// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>
#include <kys_slam/rigid3.h>

#include <cstdint>
#include <string>
#include <vector>

namespace kys_slam {

enum class FrameStatus : std::uint8_t {
  kStarted,  ///< first frame of a map
  kTracked,
  kLost,  ///< no pose; `reason` says why
};
const char* to_string(FrameStatus status);

/// Result of loop closing for a keyframe.
enum class LoopEvent : std::uint8_t {
  kNone,
  kClosed,  ///< drift within a sub-map corrected
  kMerged,  ///< two sub-maps became one
};
const char* to_string(LoopEvent event);

/// Time of the stages of one frame, ms. `total` is the time from the frame to its pose: `feed`
/// without a stall that was asked for and, in the schedule `sequential`, without the back end.
/// Times of the back end are those of the keyframe made from this frame, in whichever thread it
/// ran.
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
  bool relocalised = false;  ///< tracking failed, and relocalisation succeeded
  Rigid3 T_w_c;              ///< as estimated at this frame; undefined when lost
  int keypoints = 0;         ///< left image
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
  std::int64_t submap = -1;  ///< number of its sub-map, -1: lost
  Rigid3 T_w_c;              ///< in the world frame of its sub-map; undefined when lost
};

}  // namespace kys_slam
