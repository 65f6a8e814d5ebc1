// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/sparsification.h"

#include <algorithm>

namespace kys_slam {

void describe(kys::OptionList& list, SparsificationOptions& o) {
  list.add(
      "mapping.sparse_overlap", o.overlap, {0, 1}, "",
      "landmarks that the keyframes before and after a keyframe share, per landmark of it, "
      "above which it is culled when it leaves the window of local bundle adjustment; 1: never");
}

namespace {

/// The present keyframe of the same sub-map that is nearest in time, before (-1) or after (+1);
/// invalid when there is none.
KeyFrameId neighbour_in_time(const Map& map, KeyFrameId id, int direction) {
  const KeyFrameId submap = map.keyframe(id).submap;
  const std::uint32_t end = map.keyframe_id_end();
  for (std::uint32_t k = id.value + static_cast<std::uint32_t>(direction); k < end;
       k += static_cast<std::uint32_t>(direction)) {  // below zero it wraps to beyond the end
    if (map.has(KeyFrameId{k}) && map.keyframe(KeyFrameId{k}).submap == submap) return {k};
  }
  return {};
}

bool is_between(const Map& map, KeyFrameId id, double overlap) {
  const KeyFrameId before = neighbour_in_time(map, id, -1);
  const KeyFrameId after = neighbour_in_time(map, id, +1);
  if (!before.valid() || !after.valid()) return false;
  const std::vector<LandmarkId>& landmarks = map.keyframe(id).landmarks;
  const auto own =
      std::count_if(landmarks.begin(), landmarks.end(), [](LandmarkId l) { return l.valid(); });
  return map.keyframe(before).shared_with(after) > overlap * static_cast<double>(own);
}

}  // namespace

int Sparsification::update(Map& map, const std::vector<KeyFrameId>& window) {
  int culled = 0;
  const auto judged = [&](KeyFrameId id) {
    if (!map.has(id)) return true;
    if (std::binary_search(window.begin(), window.end(), id)) return false;
    if (is_between(map, id, options_.overlap)) culled += map.cull_keyframe(id) ? 1 : 0;
    return true;
  };
  dense_.erase(std::remove_if(dense_.begin(), dense_.end(), judged), dense_.end());
  culled_ += static_cast<std::size_t>(culled);
  return culled;
}

}  // namespace kys_slam
