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

/// What loop closing made of a keyframe.
enum class LoopEvent : std::uint8_t {
  kNone,
  kClosed,  ///< drift within a sub-map taken away
  kMerged,  ///< two sub-maps became one
};
const char* to_string(LoopEvent event);

/// ms of the stages of one frame. `total` is what the caller of `feed` waits for; the back end's
/// time is the one spent for the keyframe made of this frame, wherever it ran.
struct StageTimes {
  double total = 0;
  double extract = 0;  ///< both images
  double priors = 0;   ///< prior look-up
  double stereo = 0;
  double track = 0;      ///< prediction, local map, keyframe decision
  double predict = 0;    ///< part of track
  double local_map = 0;  ///< part of track
  double local_mapping = 0;
  double local_bundle = 0;  ///< part of local_mapping
  double loop = 0;
};

/// What came of one frame.
struct FrameReport {
  std::int64_t index = 0;
  std::string name;
  double timestamp = 0;  ///< s
  FrameStatus status = FrameStatus::kLost;
  std::string reason;  ///< why it is lost, or how its pose was predicted
  /// What is wrong with one of the images or the motion, as a phrase that stays the same while it
  /// lasts; "": nothing.
  std::string warning;
  bool relocalised = false;  ///< tracking had lost it, but it was recognised in the map
  Rigid3 T_w_c;              ///< as estimated at this frame; meaningless when lost
  int keypoints = 0;         ///< left image
  int stereo_matches = 0;
  int matches = 0;  ///< landmarks matched
  int inliers = 0;  ///< of these, after pose optimisation
  bool keyframe = false;
  LoopEvent loop = LoopEvent::kNone;
  std::int64_t loop_frame = -1;  ///< the frame it was closed with
  double loop_distance_m = 0;    ///< between the two frames as verified
  double loop_gap_m = 0;         ///< distance by which the loop was open
  double prior_coverage = 0;     ///< share of keypoints with a valid label
  int masked = 0;                ///< keypoints dropped by mode `mask`
  kys::Statistics statistics;    ///< descriptor comparisons of this frame, back end included
  StageTimes times;
  double resident_mb = 0;
};

/// Final estimate of one frame, after all optimisation.
struct FrameEstimate {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  /// False: the frame was lost, or belongs to a sub-map that was never connected to the one with
  /// most frames.
  bool connected = false;
  std::int64_t submap = -1;  ///< number of its sub-map, -1: lost
  Rigid3 T_w_c;              ///< in the frame of its sub-map; meaningless when lost
};

}  // namespace kys_slam
