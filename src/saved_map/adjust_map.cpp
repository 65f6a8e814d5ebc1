// SPDX-License-Identifier: BSD-3-Clause
#include "saved_map/adjust_map.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace kys_slam {

namespace {

constexpr double kFarthestPoint = 1e6;  // m, of a coordinate

bool is_place(const Eigen::Vector3d& p_w) {
  return p_w.allFinite() && p_w.cwiseAbs().maxCoeff() < kFarthestPoint;
}

void check(const Map& map, const MapObservations& adjusted) {
  if (adjusted.keyframe_ids.size() != adjusted.T_c_w.size() ||
      adjusted.landmark_ids.size() != adjusted.landmarks.size()) {
    throw std::invalid_argument("an adjusted map has other numbers of ids than of objects");
  }
  for (std::size_t k = 0; k < adjusted.T_c_w.size(); ++k) {
    if (!map.has(KeyFrameId{adjusted.keyframe_ids[k]}) || !adjusted.T_c_w[k].is_finite()) {
      throw std::invalid_argument("an adjusted map has a keyframe of another map, or without pose");
    }
  }
  for (std::size_t k = 0; k < adjusted.landmarks.size(); ++k) {
    if (!map.has(LandmarkId{adjusted.landmark_ids[k]})) {
      throw std::invalid_argument("an adjusted map has a landmark of another one");
    }
  }
  if (!adjusted.rig.correction.parameters().allFinite() || !adjusted.rig.covariance.allFinite()) {
    throw std::invalid_argument("an adjusted map has a correction that is not finite");
  }
}

/// Where the reference keyframe of every landmark sees it, by its disparity, m; NaN without one.
std::vector<Eigen::Vector3d> seen_from_reference(const Map& map) {
  std::vector<Eigen::Vector3d> seen;
  map.landmarks().for_each([&](LandmarkId, const Landmark& landmark) {
    seen.push_back(Eigen::Vector3d::Constant(std::nan("")));
    for (const Observation& o : landmark.observations) {
      if (o.keyframe != landmark.reference) continue;
      const FrameFeatures& features = *map.keyframe(o.keyframe).features;
      if (!features.has_stereo(o.feature)) continue;
      const Keypoint& k = features.keypoint(o.feature);
      seen.back() = map.camera().back_project(k.x, k.y, features.depth(o.feature));
    }
  });
  return seen;
}

}  // namespace

void adjust_map(Map& map, const MapObservations& adjusted) {
  check(map, adjusted);
  std::vector<KeyFrameId> ids;
  for (const std::uint32_t id : adjusted.keyframe_ids) ids.push_back({id});
  map.move_keyframes(ids, adjusted.T_c_w);
  if (!(adjusted.rig.correction == map.rig())) {
    const std::vector<Eigen::Vector3d> before = seen_from_reference(map);
    map.set_rig(adjusted.rig);
    const std::vector<Eigen::Vector3d> after = seen_from_reference(map);
    const std::vector<LandmarkId> all = map.landmarks().ids();
    for (std::size_t k = 0; k < all.size(); ++k) {
      const Landmark& landmark = map.landmark(all[k]);
      const Eigen::Vector3d moved = after[k] - before[k];
      const Rigid3 T_w_c = map.keyframe(landmark.reference).T_c_w.inverse();
      const Eigen::Vector3d p_w = landmark.p_w + T_w_c.R() * moved;
      if (is_place(p_w)) map.set_position(all[k], p_w);
    }
  } else {
    map.set_rig(adjusted.rig);  // its covariance
  }
  for (std::size_t k = 0; k < adjusted.landmarks.size(); ++k) {
    if (is_place(adjusted.landmarks[k])) {
      map.set_position(LandmarkId{adjusted.landmark_ids[k]}, adjusted.landmarks[k]);
    }
  }
  map.refresh_geometry(map.landmarks().ids());
}

}  // namespace kys_slam
