// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/stereo_camera.h>

#include "map/replica.h"
#include "tracking/beliefs.h"
#include "tracking/local_map.h"
#include "tracking/motion_model.h"
#include "tracking/tracked_frame.h"
#include "tracking/tracker_options.h"

namespace kys_slam {

/// All that sources of candidates and the judge may read besides the frame itself. Owned by the
/// tracker, valid while one frame is tracked.
struct TrackingContext {
  const StereoCamera& camera;
  const ScaleLevels& scales;
  const TrackerOptions& options;
  const kys::DistanceModel& model;
  const Replica& replica;
  const MotionModel& motion;
  Beliefs beliefs;
  LocalMapGatherer& gatherer;          ///< its memory is used again; it keeps nothing
  const TrackedFrame* last = nullptr;  ///< last frame with a pose; null: none
  KeyFrameId reference;                ///< keyframe that shares most with the last frame
};

}  // namespace kys_slam
