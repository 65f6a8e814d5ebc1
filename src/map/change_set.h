// SPDX-License-Identifier: BSD-3-Clause
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

/// The part of a landmark that the tracker uses. In an order without gaps: there are very many.
struct LandmarkView {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float min_distance = 0;
  float max_distance = 0;
  kys::Prior prior;
  kys::Descriptor descriptor;
  std::vector<KeyFrameId> observers;  ///< by id
  friend bool operator==(const LandmarkView&, const LandmarkView&) = default;
};

/// The part of a landmark that changes when the map moves.
struct LandmarkGeometry {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float min_distance = 0;
  float max_distance = 0;
};

/// The part of a keyframe that the tracker uses.
struct KeyFrameView {
  Rigid3 T_c_w;
  std::shared_ptr<const FrameFeatures> features;
  std::vector<LandmarkId> landmarks;   ///< per feature
  std::vector<KeyFrameId> neighbours;  ///< best covisible ones, largest weight first
  KeyFrameId parent;
  std::vector<KeyFrameId> children;
  KeyFrameId submap;  ///< first keyframe of its sub-map
};

/// A culled keyframe: poses relative to it are resolved through its parent.
struct CulledKeyFrame {
  KeyFrameId id;
  KeyFrameId parent;
  Rigid3 T_c_parent;  ///< fixed at the time of culling
};

/// Standard deviations of a rig's correction that change lengths; zero: it was not corrected.
struct RigSigma {
  double offset = 0;  ///< px, of all disparities
  double focal = 0;   ///< share of the focal length
};

/// Changes of the map since the last change set, as far as the tracker uses them. Applied to a
/// replica of the earlier state, it gives a replica of the later state.
struct ChangeSet {
  std::vector<std::pair<LandmarkId, LandmarkView>> landmarks;  ///< new or changed, by id
  /// Landmarks with changed geometry only, by id. Most are of this kind, since bundle adjustment
  /// moves every landmark.
  std::vector<std::pair<LandmarkId, LandmarkGeometry>> moved_landmarks;
  std::vector<LandmarkId> erased_landmarks;  ///< by id
  std::vector<std::pair<LandmarkId, LandmarkId>>
      replaced;  ///< old (erased) id -> id of its successor
  std::vector<std::pair<KeyFrameId, KeyFrameView>> keyframes;  ///< new or changed, by id
  std::vector<CulledKeyFrame> culled_keyframes;                ///< in the order of culling
  bool moved = false;  ///< many keyframes moved together, as by a loop
  RigCorrection rig;   ///< of new frames
  RigSigma rig_sigma;  ///< of that correction
  double scale = 1;    ///< Map::scale
};

}  // namespace kys_slam
