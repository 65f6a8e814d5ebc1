// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/local_map.h"

#include <algorithm>

namespace kys_slam {

LocalMap LocalMapGatherer::gather(const Replica& replica,
                                  std::span<const LandmarkId> frame_landmarks) {
  LocalMap local;
  votes_.resize(replica.keyframes().id_end(), 0);
  replica.landmarks().visit(frame_landmarks, [&](LandmarkId, const LandmarkView& landmark) {
    for (const KeyFrameId observer : landmark.observers) {
      if (!replica.keyframes().contains(observer)) continue;
      if (votes_[observer.value]++ == 0) local.keyframes.push_back(observer);
    }
  });
  std::sort(local.keyframes.begin(), local.keyframes.end());
  int most = 0;
  for (const KeyFrameId id : local.keyframes) {
    if (votes_[id.value] >= most) {  // ties: the younger one
      most = votes_[id.value];
      local.reference = id;
    }
  }

  const std::size_t voters = local.keyframes.size();
  const auto add_first_new = [&](std::span<const KeyFrameId> candidates) {
    for (const KeyFrameId id : candidates) {
      if (!replica.keyframes().contains(id) || votes_[id.value] != 0) continue;
      votes_[id.value] = 1;
      local.keyframes.push_back(id);
      return;
    }
  };
  for (std::size_t k = 0; k < voters && local.keyframes.size() < max_keyframes_; ++k) {
    const KeyFrameView& keyframe = replica.keyframes().at(local.keyframes[k]);
    add_first_new(keyframe.neighbours);
    add_first_new(keyframe.children);
    if (keyframe.parent.valid()) add_first_new({&keyframe.parent, 1});
  }
  for (const KeyFrameId id : local.keyframes) votes_[id.value] = 0;

  // One bit each, so that the many landmarks that several keyframes observe cost little.
  included_.assign(replica.landmarks().id_end(), false);
  for (const KeyFrameId id : local.keyframes) {
    for (const LandmarkId landmark : replica.keyframes().at(id).landmarks) {
      if (landmark.value >= included_.size() || included_[landmark.value]) continue;
      included_[landmark.value] = true;
      if (replica.landmarks().contains(landmark)) local.landmarks.push_back(landmark);
    }
  }
  return local;
}

}  // namespace kys_slam
