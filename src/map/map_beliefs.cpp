// SPDX-License-Identifier: BSD-3-Clause
// What is known and believed of instances: priors of keyframes and landmarks.
#include <kys/prior.h>

#include <algorithm>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "map/map.h"
#include "map/sort_ids.h"

namespace kys_slam {

void Map::keep_beliefs() {
  if (keeps_beliefs_) return;
  keeps_beliefs_ = true;
  for (const LandmarkId id : landmarks_.ids()) index_instance(id);
}

int Map::set_beliefs(std::span<const InstanceBelief> beliefs, double patience) {
  std::map<std::int32_t, InstanceBelief> changed;
  for (const InstanceBelief& belief : beliefs) {
    changed[belief.instance] = beliefs_[belief.instance] = belief;
  }
  std::vector<LandmarkId> gone;
  for (const auto& [instance, belief] : changed) {
    const auto found = on_instance_.find(instance);
    if (found == on_instance_.end()) continue;
    std::vector<LandmarkId>& ids = found->second;
    sort_unique(ids);
    std::erase_if(ids, [&, on = instance](LandmarkId id) {
      return !has(id) || landmark(id).prior.instance != on;
    });
    if (belief.moving_for > patience) {
      gone.insert(gone.end(), ids.begin(), ids.end());
      continue;
    }
    for (const LandmarkId id : ids) {
      Landmark& landmark = landmarks_.at(id);
      const kys::Prior prior = kys::with_belief(landmark.prior, belief.p_static);
      if (prior == landmark.prior) continue;
      landmark.prior = prior;
      touch(id);
    }
  }
  std::sort(gone.begin(), gone.end());
  for (const LandmarkId id : gone) erase_landmark(id);
  return static_cast<int>(gone.size());
}

bool Map::set_priors(KeyFrameId id, const std::vector<kys::Prior>& priors) {
  KeyFrame* keyframe = keyframes_.find(id);
  if (keyframe == nullptr || keyframe->features->size() != priors.size()) return false;
  std::vector<LandmarkId> changed;
  for (std::size_t i = 0; i < priors.size(); ++i) {
    const kys::Prior& before = keyframe->features->prior(i);
    const bool same = before.label == priors[i].label && before.instance == priors[i].instance;
    if (!same && keyframe->landmarks[i].valid()) changed.push_back(keyframe->landmarks[i]);
  }
  keyframe->features =
      std::make_shared<const FrameFeatures>(keyframe->features->with_priors(priors));
  touch(id);
  for (const LandmarkId landmark : changed) refresh_landmark(landmark);
  return true;
}

std::int32_t Map::instance_end(std::span<const std::uint8_t> is_thing) const {
  std::int32_t end = 0;
  const auto see = [&](const kys::Prior& prior) {
    if (prior.label >= is_thing.size() || is_thing[prior.label] == 0 || prior.instance < 0) return;
    end = std::max(end, prior.instance % kys::kRightInstances + 1);
  };
  keyframes_.for_each([&](KeyFrameId, const KeyFrame& k) {
    for (const kys::Prior& prior : k.features->priors()) see(prior);
  });
  landmarks_.for_each([&](LandmarkId, const Landmark& l) { see(l.prior); });
  return end;
}

}  // namespace kys_slam
