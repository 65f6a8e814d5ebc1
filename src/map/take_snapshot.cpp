// SPDX-License-Identifier: BSD-3-Clause
#include "map/take_snapshot.h"

#include <algorithm>
#include <map>

#include "map/map.h"

namespace kys_slam {

namespace {

void add_edges(const Map& map, KeyFrameId id, const KeyFrame& keyframe, MapSnapshot& snapshot) {
  const std::vector<KeyFrameId>& loops = keyframe.loop_edges;
  std::map<KeyFrameId, int> shared;
  for (const Covisible& c : keyframe.covisible) shared[c.keyframe] = c.weight;
  if (keyframe.parent.valid()) shared.try_emplace(keyframe.parent, 0);
  for (const KeyFrameId child : keyframe.children) shared.try_emplace(child, 0);
  for (const KeyFrameId other : loops) shared.try_emplace(other, 0);
  for (const auto& [other, weight] : shared) {
    if (!(other < id)) continue;
    const bool tree = keyframe.parent == other || map.keyframe(other).parent == id;
    const bool loop = std::binary_search(loops.begin(), loops.end(), other);
    if (weight < Map::kCovisibilityMin && !tree && !loop) continue;
    snapshot.edges.push_back({id.value, other.value, weight, tree, loop});
  }
}

}  // namespace

MapSnapshot take_snapshot(const Map& map) {
  MapSnapshot snapshot;
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    snapshot.keyframes.push_back(
        {id.value, keyframe.submap.value, keyframe.timestamp, keyframe.T_c_w.inverse()});
    add_edges(map, id, keyframe, snapshot);
  });
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    snapshot.landmarks.push_back({id.value, map.submap(landmark.reference).value,
                                  landmark.prior.label, landmark.prior.instance,
                                  map.weight(landmark),
                                  static_cast<std::uint32_t>(landmark.observations.size()),
                                  landmark.reference.value, landmark.p_w});
  });
  return snapshot;
}

}  // namespace kys_slam
