// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "map/keyframe_message.h"
#include "motion/instance_tracker.h"
#include "tracking/integrity_check.h"
#include "tracking/pose_uncertainty.h"
#include "tracking/tracked_frame.h"

namespace kys_slam {

enum class TrackingStatus : std::uint8_t { kStarted, kTracked, kLost };

struct TrackTimes {
  double predict = 0;    ///< ms
  double local_map = 0;  ///< ms
  double keyframe = 0;   ///< ms
};

struct TrackResult {
  TrackingStatus status = TrackingStatus::kLost;
  bool relocalised = false;  ///< tracking failed, and relocalisation succeeded
  std::string reason;        ///< why it is lost, or how the pose was found
  double taken = 0;          ///< s, when its image was taken: the time stamp without its jitter
  Rigid3 T_c_w;              ///< undefined when lost
  FramePose pose;
  std::optional<PoseUncertainty> uncertainty;  ///< when tracked
  int matches = 0;                             ///< landmarks matched, outliers included
  int inliers = 0;
  bool held = false;       ///< the expected pose was used as a prior
  bool jumped = false;     ///< the pose found near the prediction needs an impossible acceleration
  bool refused = false;    ///< a pose was found, and not believed
  bool overruled = false;  ///< image area gave another pose than the number of matches
  IntegrityResult integrity;
  std::vector<InstanceState> instances;  ///< of the frame, when the mode uses belief
  TrackTimes times;
  kys::Statistics statistics;
  std::optional<KeyFrameMessage> keyframe;  ///< for the back end
};

}  // namespace kys_slam
