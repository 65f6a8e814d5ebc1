// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "map/frame_features.h"
#include "map/ids.h"

namespace kys_slam {

/// Another keyframe and the number of shared landmarks.
struct Covisible {
  KeyFrameId keyframe;
  int weight = 0;
  friend bool operator==(const Covisible&, const Covisible&) = default;
};

/// Motion expected between two keyframes. It holds one whose observations say little of its pose.
struct ExpectedMotion {
  KeyFrameId reference;
  Rigid3 T_c_reference;
  double scale = 1;           ///< Map::scale of T_c_reference
  double sigma_position = 1;  ///< m
  double sigma_rotation = 1;  ///< rad
};

/// A frame kept in the map.
struct KeyFrame {
  KeyFrameId id;
  KeyFrameId submap;  ///< first keyframe of its sub-map
  std::int64_t frame_index = 0;
  double timestamp = 0;  ///< s
  Rigid3 T_c_w;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< m, T_c_w.inverse_t(); set by the map
  std::shared_ptr<const FrameFeatures> features;
  std::vector<LandmarkId> landmarks;     ///< per feature; invalid: none
  std::vector<Covisible> covisible;      ///< all with weight >= 1, by id
  KeyFrameId parent;                     ///< in the spanning tree; invalid at its root
  std::vector<KeyFrameId> children;      ///< by id
  std::vector<KeyFrameId> loop_edges;    ///< by id
  std::optional<ExpectedMotion> motion;  ///< not stored in map files

  /// Landmarks that this keyframe shares with another one; 0: none.
  [[nodiscard]] int shared_with(KeyFrameId other) const {
    const auto at =
        std::lower_bound(covisible.begin(), covisible.end(), other,
                         [](const Covisible& c, KeyFrameId wanted) { return c.keyframe < wanted; });
    return at != covisible.end() && at->keyframe == other ? at->weight : 0;
  }
};

}  // namespace kys_slam
