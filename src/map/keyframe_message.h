// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "map/frame_features.h"
#include "map/ids.h"
#include "map/instance_belief.h"
#include "map/keyframe.h"

namespace kys_slam {

/// A landmark made by the tracker from one stereo feature of a new keyframe.
struct NewLandmark {
  LandmarkId id;
  std::uint32_t feature = 0;
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  ///< m
};

/// In how many frames a landmark was predicted and matched since the last message.
struct VisibilityCount {
  LandmarkId id;
  std::uint32_t visible = 0;
  std::uint32_t found = 0;
};

/// Priors of an earlier keyframe that became known later.
struct KeyFramePriors {
  KeyFrameId keyframe;
  std::vector<kys::Prior> priors;  ///< one per feature that it was made with
};

/// Message from the tracker to the back end: a keyframe, its observations and its new landmarks.
struct KeyFrameMessage {
  KeyFrameId id;
  std::int64_t frame_index = 0;
  double timestamp = 0;  ///< s
  Rigid3 T_c_w;
  std::shared_ptr<const FrameFeatures> features;
  std::vector<LandmarkId> tracked;          ///< per feature; landmarks matched
  std::vector<NewLandmark> new_landmarks;   ///< by feature
  std::vector<VisibilityCount> counts;      ///< by landmark
  std::vector<InstanceBelief> beliefs;      ///< those that changed since the last message
  std::vector<KeyFramePriors> late_priors;  ///< since the last message
  KeyFrameId reference;  ///< reference keyframe of tracking; parent if none is covisible
  Rigid3 T_c_reference;  ///< measured relative pose: the map may have changed since
  double scale = 1;      ///< Map::scale at which it was measured
  std::optional<ExpectedMotion> motion;  ///< where observations say little of the pose
};

}  // namespace kys_slam
