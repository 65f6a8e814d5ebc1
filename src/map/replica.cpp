#include "map/replica.h"

namespace kys_slam {

void Replica::apply(const ChangeSet& changes) {
  for (const LandmarkId id : changes.erased_landmarks) landmarks_.erase(id);
  for (const auto& [from, into] : changes.replaced) successor_.put(from, into);
  for (const auto& [id, view] : changes.landmarks) landmarks_.put(id, view);
  for (const auto& [id, view] : changes.keyframes) keyframes_.put(id, view);
  for (const CulledKeyFrame& culled : changes.culled_keyframes) {
    keyframes_.erase(culled.id);
    culled_.put(culled.id, culled);
  }
}

LandmarkId Replica::resolve(LandmarkId id) const {
  return resolve_replaced(landmarks_, successor_, id);
}

Replica::Anchor Replica::resolve(KeyFrameId id) const {
  Anchor anchor{id, Rigid3{}};
  while (const CulledKeyFrame* culled = culled_.find(anchor.keyframe)) {
    anchor = {culled->parent, anchor.T_c_k * culled->T_c_parent};
  }
  return anchor;
}

}  // namespace kys_slam
