// SPDX-License-Identifier: BSD-3-Clause
// What has changed, for the replicas of the map.
#include <algorithm>
#include <cmath>
#include <utility>

#include "map/map.h"
#include "map/sort_ids.h"

namespace kys_slam {

LandmarkView Map::view(LandmarkId id) const {
  const Landmark& l = landmark(id);
  LandmarkView view{l.p_w, l.normal, l.min_distance, l.max_distance, l.prior, l.descriptor, {}};
  view.observers.reserve(l.observations.size());
  for (const Observation& o : l.observations) view.observers.push_back(o.keyframe);
  return view;
}

KeyFrameView Map::view(KeyFrameId id) const {
  const KeyFrame& k = keyframe(id);
  return {k.T_c_w,  k.features, k.landmarks, best_covisible(id, kViewNeighbours),
          k.parent, k.children, k.submap};
}

ChangeSet Map::take_changes() {
  ChangeSet changes;
  changes.rig = rig();
  const auto sigma = [&](RigParameter p) {
    return std::sqrt(rig_.covariance(static_cast<int>(p), static_cast<int>(p)));
  };
  changes.rig_sigma = {sigma(RigParameter::kOffset), sigma(RigParameter::kFocal)};
  changes.scale = scale_;
  changes.moved = std::exchange(moved_, false);
  sort_unique(dirty_landmarks_);
  changes.landmarks.reserve(dirty_landmarks_.size());
  for (const LandmarkId id : dirty_landmarks_) {
    if (has(id)) changes.landmarks.emplace_back(id, view(id));
  }
  sort_unique(moved_landmarks_);
  changes.moved_landmarks.reserve(moved_landmarks_.size());
  auto dirty = dirty_landmarks_.begin();
  for (const LandmarkId id : moved_landmarks_) {
    while (dirty != dirty_landmarks_.end() && *dirty < id) ++dirty;
    if ((dirty != dirty_landmarks_.end() && *dirty == id) || !has(id)) continue;
    const Landmark& l = landmark(id);
    changes.moved_landmarks.emplace_back(
        id, LandmarkGeometry{l.p_w, l.normal, l.min_distance, l.max_distance});
  }
  std::sort(dirty_keyframes_.begin(), dirty_keyframes_.end());
  for (const KeyFrameId id : dirty_keyframes_) {
    is_dirty_[id.value] = 0;
    if (has(id)) changes.keyframes.emplace_back(id, view(id));
  }
  std::sort(erased_landmarks_.begin(), erased_landmarks_.end());
  changes.erased_landmarks = std::move(erased_landmarks_);
  changes.replaced = std::move(replaced_);
  changes.culled_keyframes = std::move(newly_culled_);
  dirty_landmarks_ = {};  // may have had the whole map
  moved_landmarks_ = {};
  dirty_keyframes_.clear();
  erased_landmarks_.clear();
  replaced_.clear();
  newly_culled_.clear();
  return changes;
}

}  // namespace kys_slam
