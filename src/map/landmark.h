// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>
#include <kys/distance.h>

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <vector>

#include "map/ids.h"

namespace kys_slam {

/// Feature number `feature` of a keyframe observes the landmark.
struct Observation {
  KeyFrameId keyframe;
  std::uint32_t feature = 0;
  friend bool operator==(const Observation&, const Observation&) = default;
};

/// Where that of a keyframe is, or would be, among the observations of a landmark.
inline std::vector<Observation>::iterator lower_observation(std::vector<Observation>& observations,
                                                            KeyFrameId keyframe) {
  return std::lower_bound(
      observations.begin(), observations.end(), keyframe,
      [](const Observation& o, KeyFrameId wanted) { return o.keyframe < wanted; });
}

/// A number of frames, as a landmark counts them.
[[nodiscard]] inline std::uint16_t frame_count(std::uint64_t frames) {
  return static_cast<std::uint16_t>(std::min<std::uint64_t>(frames, 0xffff));
}

/// A point of the map. In an order without gaps: there are very many.
struct Landmark {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();     ///< m
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< mean viewing direction, camera to point
  float min_distance = 0;                            ///< m, least distance from which it is matched
  float max_distance = 0;                            ///< m, largest distance
  kys::Prior prior;  ///< label, instance, scale of the representative observation; motion of the
                     ///< most recent one
  kys::Descriptor descriptor;  ///< representative: least median distance to the others
  LandmarkId id;
  KeyFrameId reference;       ///< keyframe that defines the distance range
  KeyFrameId first_keyframe;  ///< keyframe that made it
  std::uint16_t visible = 1;  ///< frames in which it was predicted in view, 65535 and more: 65535
  std::uint16_t found = 1;    ///< frames in which it was matched, the same
  std::vector<Observation> observations;  ///< by keyframe id
};

}  // namespace kys_slam
