// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <vector>

#include "map/change_set.h"
#include "map/frame_features.h"
#include "map/keyframe.h"
#include "map/landmark.h"

namespace kys_slam {

/// The contents of a map, by value and by id, as stored on disk. Derived data (landmarks, covisible
/// and children of a keyframe) is empty and ignored. Successors of replaced landmarks are not
/// included: only messages in transit refer to them.
struct MapContents {
  StereoCamera camera;
  ScaleLevels scales;
  RigEstimate rig;
  std::vector<KeyFrame> keyframes;     ///< by id
  std::vector<CulledKeyFrame> culled;  ///< by id
  std::vector<Landmark> landmarks;     ///< by id
  std::uint32_t keyframe_id_end = 0;   ///< one past the largest id ever used
  std::uint32_t landmark_id_end = 0;
  bool beliefs = false;  ///< the motion of all priors is belief (kys::with_belief), not mu

  /// Whether any feature or landmark has a prior.
  [[nodiscard]] bool has_priors() const;
};

}  // namespace kys_slam
