// SPDX-License-Identifier: BSD-3-Clause
#include "map/replica.h"

#include <algorithm>

namespace kys_slam {

void Replica::put_pending(KeyFrameId id, KeyFrameView view) {
  put(id, std::move(view));
  pending_.push_back(id);
}

void Replica::apply(ChangeSet changes) {
  std::vector<std::pair<KeyFrameId, Rigid3>> hanging;  // T_c_parent
  for (const KeyFrameId id : pending_) {
    const KeyFrameView& view = keyframes_.at(id);
    if (!changes.moved || !view.parent.valid()) continue;
    const Anchor parent = resolve(view.parent);
    const Rigid3 T_p_w = parent.T_c_k * keyframes_.at(parent.keyframe).T_c_w;
    Rigid3 T_c_p = view.T_c_w * T_p_w.inverse();
    T_c_p.translation *= changes.scale / scale_;
    hanging.emplace_back(id, T_c_p);
  }
  scale_ = changes.scale;
  for (const LandmarkId id : changes.erased_landmarks) landmarks_.erase(id);
  for (const auto& [from, into] : changes.replaced) landmarks_.replace(from, into);
  for (auto& [id, view] : changes.landmarks) landmarks_.put(id, std::move(view));
  for (const auto& [id, geometry] : changes.moved_landmarks) {
    LandmarkView& view = landmarks_.at(id);
    view.p_w = geometry.p_w;
    view.normal = geometry.normal;
    view.min_distance = geometry.min_distance;
    view.max_distance = geometry.max_distance;
  }
  for (auto& [id, view] : changes.keyframes) keyframes_.put(id, std::move(view));
  for (const CulledKeyFrame& culled : changes.culled_keyframes) {
    keyframes_.erase(culled.id);
    culled_.put(culled.id, culled);
  }
  const auto came = [&](KeyFrameId id) {
    const auto is_it = [&](const auto& entry) { return entry.first == id; };
    return !keyframes_.contains(id) || std::ranges::any_of(changes.keyframes, is_it);
  };
  std::erase_if(pending_, came);
  for (const auto& [id, T_c_parent] : hanging) {
    if (std::ranges::binary_search(pending_, id)) follow(id, T_c_parent);
  }
}

void Replica::set_priors(KeyFrameId id, const std::vector<kys::Prior>& priors) {
  KeyFrameView* view = keyframes_.find(id);
  if (view == nullptr || view->features->size() != priors.size()) return;
  view->features = std::make_shared<const FrameFeatures>(view->features->with_priors(priors));
  for (std::size_t i = 0; i < priors.size(); ++i) {
    LandmarkView* landmark = landmarks_.find(view->landmarks[i]);
    if (landmark != nullptr) landmark->prior = priors[i];
  }
}

void Replica::follow(KeyFrameId pending, const Rigid3& T_c_parent) {
  KeyFrameView& view = keyframes_.at(pending);
  const Anchor parent = resolve(view.parent);
  const KeyFrameView& there = keyframes_.at(parent.keyframe);
  const Rigid3 T_c_w = T_c_parent * parent.T_c_k * there.T_c_w;
  const Rigid3 T_new_old = T_c_w.inverse() * view.T_c_w;
  view.T_c_w = T_c_w;
  view.submap = there.submap;
  for (const LandmarkId id : view.landmarks) {
    LandmarkView* landmark = landmarks_.find(id);
    if (landmark == nullptr || landmark->observers.empty()) continue;
    if (landmark->observers.front() != pending) continue;
    landmark->p_w = T_new_old * landmark->p_w;
    landmark->normal = (T_new_old.rotation * landmark->normal.cast<double>()).cast<float>();
  }
}

Replica::Anchor Replica::resolve(KeyFrameId id) const {
  Anchor anchor{id, Rigid3{}};
  while (const CulledKeyFrame* culled = culled_.find(anchor.keyframe)) {
    anchor = {culled->parent, anchor.T_c_k * culled->T_c_parent};
  }
  return anchor;
}

}  // namespace kys_slam
