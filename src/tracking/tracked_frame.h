// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/prior.h>
#include <kys_slam/rigid3.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "map/frame_features.h"
#include "map/ids.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

struct ImagePyramid;

/// Pose of a frame relative to a keyframe, so that it moves with the map.
struct FramePose {
  KeyFrameId reference;  ///< invalid: not connected to the map
  Rigid3 T_c_reference;
  double scale = 1;  ///< Map::scale at which it was measured

  /// T_c_reference in a map of another scale.
  [[nodiscard]] Rigid3 at_scale(double other) const { return scaled(T_c_reference, other / scale); }
};

/// A frame while it is tracked, and the last one with a pose.
struct TrackedFrame {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  double taken = 0;      ///< s, when its image was taken: MotionModel::time_of
  std::shared_ptr<const FrameFeatures> features;
  std::vector<LandmarkId> landmarks;  ///< per feature; invalid: none
  Rigid3 T_c_w;
  FramePose pose;
  std::optional<PosePrior> held;         ///< the expected pose, when it was used as a prior
  const ImagePyramid* left = nullptr;    ///< while the frame is tracked; null: no image
  std::span<const kys::Prior> segments;  ///< of the left image, while the frame is tracked

  [[nodiscard]] int landmark_count() const {
    return static_cast<int>(std::ranges::count_if(landmarks, &LandmarkId::valid));
  }
};

}  // namespace kys_slam
