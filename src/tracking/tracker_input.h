// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "map/frame_features.h"
#include "map/ids.h"

namespace kys_slam {

struct ImagePyramid;

/// A frame from the front end.
struct TrackerInput {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  std::shared_ptr<const FrameFeatures> features;
  const ImagePyramid* left = nullptr;         ///< of the left image; null: features without images
  bool repeated = false;                      ///< the left image is that of the frame before
  std::span<const kys::Prior> segments = {};  ///< of the left image, with or without keypoints
};

/// Priors of the features of an earlier frame, from segments that came after it was tracked.
struct LatePriors {
  std::int64_t frame = 0;
  std::optional<KeyFrameId> keyframe;  ///< that it became
  std::vector<kys::Prior> priors;      ///< one per feature
};

/// Place and pose of a frame recognised in the map.
struct KnownPlace {
  KeyFrameId reference;
  Rigid3 T_c_w;
  std::vector<LandmarkId> landmarks;  ///< per feature; invalid: none
};

}  // namespace kys_slam
