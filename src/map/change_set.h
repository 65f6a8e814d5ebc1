#pragma once

#include <kys_slam/rigid3.h>

#include <memory>
#include <utility>
#include <vector>

#include "map/frame_features.h"
#include "map/ids.h"
#include "map/keyframe.h"
#include "map/landmark.h"

namespace kys_slam {

/// What the tracker knows of a landmark.
struct LandmarkView {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float min_distance = 0;
  float max_distance = 0;
  kys::Descriptor descriptor;
  kys::Prior prior;
  std::vector<KeyFrameId> observers;  ///< by id
  friend bool operator==(const LandmarkView&, const LandmarkView&) = default;
};

/// Of a landmark, what moves with the map.
struct LandmarkGeometry {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float min_distance = 0;
  float max_distance = 0;
};

/// What the tracker knows of a keyframe.
struct KeyFrameView {
  Rigid3 T_c_w;
  std::shared_ptr<const FrameFeatures> features;
  std::vector<LandmarkId> landmarks;   ///< per feature
  std::vector<KeyFrameId> neighbours;  ///< best covisible ones, heaviest first
  KeyFrameId parent;
  std::vector<KeyFrameId> children;
  KeyFrameId submap;  ///< keyframe that began its sub-map
};

/// A keyframe that was culled: frames that refer to it go on through its parent.
struct CulledKeyFrame {
  KeyFrameId id;
  KeyFrameId parent;
  Rigid3 T_c_parent;  ///< fixed at the time of culling
};

/// Everything that changed in the map since the last change set, as the tracker needs it. Applied
/// to a replica of the earlier state it gives a replica of the later one.
struct ChangeSet {
  std::vector<std::pair<LandmarkId, LandmarkView>> landmarks;  ///< new or changed, by id
  /// Those of which nothing else changed, by id: most, as every adjustment moves all it sees.
  std::vector<std::pair<LandmarkId, LandmarkGeometry>> moved_landmarks;
  std::vector<LandmarkId> erased_landmarks;                    ///< by id
  std::vector<std::pair<LandmarkId, LandmarkId>> replaced;     ///< old (erased) -> its successor
  std::vector<std::pair<KeyFrameId, KeyFrameView>> keyframes;  ///< new or changed, by id
  std::vector<CulledKeyFrame> culled_keyframes;                ///< in the order of culling
  bool moved = false;          ///< keyframes as a whole, as when a loop closes
  float disparity_offset = 0;  ///< px, what new frames should add to their disparities
};

}  // namespace kys_slam
