// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <cstdint>

#include "map/ids.h"
#include "tracking/frame_covariance.h"

namespace kys_slam {

struct TrackedFrame;
struct TrackingContext;

/// How well the pose of a tracked frame is known. Covariances are FrameCovariance's.
struct PoseUncertainty {
  KeyFrameId reference;  ///< keyframe before this frame, not the one that it became
  Rigid3 T_reference_c;
  std::int64_t last = -1;  ///< index of the last frame with a pose, where a motion is known
  Rigid3 T_last_c;         ///< the motion since then
  FrameCovariance::Result covariance;  ///< of T_reference_c and of T_last_c
};

/// That of a frame with an accepted pose, before it becomes a keyframe.
/// \param continues whether it follows on the last frame: not after a relocalisation
/// \param last_keyframe keyframe that the last frame became; invalid: none
PoseUncertainty uncertainty_of(const TrackingContext& context, const TrackedFrame& frame,
                               bool continues, KeyFrameId last_keyframe,
                               FrameCovariance& covariance);

}  // namespace kys_slam
