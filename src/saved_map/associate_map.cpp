// SPDX-License-Identifier: BSD-3-Clause
#include "saved_map/associate_map.h"

#include <kys/distance_model.h>

#include <vector>

#include "geometry/chi_square.h"
#include "geometry/reprojection.h"
#include "loop_closing/strict_distances.h"
#include "map/seen_landmarks.h"
#include "mapping/fusion.h"

namespace kys_slam {

namespace {

/// The bound that holds for observations that are found, too.
bool agrees(const Map& map, const Landmark& landmark, const Observation& o) {
  const KeyFrame& keyframe = map.keyframe(o.keyframe);
  const FrameFeatures& features = *keyframe.features;
  const Eigen::Vector3d p_c = keyframe.T_c_w * landmark.p_w;
  if (p_c.z() <= 0) return false;
  const Keypoint& k = features.keypoint(o.feature);
  const bool stereo = features.has_stereo(o.feature);
  const Eigen::Vector3d e =
      reprojection_error(map.camera(), p_c, k.x, k.y, stereo ? features.u_right(o.feature) : 0) *
      map.scales().inv_sigma(k.octave);
  return stereo ? e.squaredNorm() <= kChi2Stereo95 : e.head<2>().squaredNorm() <= kChi2Mono95;
}

int drop_wrong(Map& map) {
  struct Wrong {
    LandmarkId landmark;
    KeyFrameId keyframe;
  };
  std::vector<Wrong> wrong;
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    for (const Observation& o : landmark.observations) {
      if (!agrees(map, landmark, o)) wrong.push_back({id, o.keyframe});
    }
  });
  for (const Wrong& w : wrong) {
    if (map.has(w.landmark)) map.remove_observation(w.landmark, w.keyframe);
  }
  return static_cast<int>(wrong.size());
}

}  // namespace

AssociationReport associate_map(Map& map) {
  const kys::DistanceModel model;  // descriptors alone: gates of priors are of one frame's motion
  kys::Statistics statistics;
  FusionOptions fusion;
  make_strict(map.scales().distances, fusion);
  AssociationReport report;
  report.dropped = drop_wrong(map);
  for (const KeyFrameId id : map.keyframes().ids()) {
    report.found += fuse_landmarks(map, id, fusion, model, statistics);
  }
  return report;
}

}  // namespace kys_slam
