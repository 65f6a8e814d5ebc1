// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/thinning.h"

#include <algorithm>

namespace kys_slam {

void describe(kys::OptionList& list, ThinningOptions& o) {
  list.add("mapping.thin_after", o.patience, {0, 1e9}, "keyframes",
           "keyframes since a keyframe last shared landmarks with the newest one, after which its "
           "features without a landmark are removed; 0: never");
}

void Thinning::continue_map(const Map& map) {
  full_.clear();
  const KeyFrameId now{map.keyframe_id_end()};
  for (const KeyFrameId id : map.keyframes().ids()) full_.push_back({id, now});
}

int Thinning::update(Map& map, KeyFrameId current) {
  if (options_.patience <= 0 || !map.has(current)) return 0;
  full_.push_back({current, current});
  const KeyFrame& newest = map.keyframe(current);
  int thinned = 0;
  const auto done = [&](FullKeyFrame& full) {
    if (!map.has(full.keyframe)) return true;
    if (newest.shared_with(full.keyframe) > 0) full.last_use = current;
    const std::uint32_t unused = current.value - full.last_use.value;
    if (unused < static_cast<std::uint32_t>(options_.patience)) return false;
    thinned += map.thin_keyframe(full.keyframe) > 0 ? 1 : 0;
    return true;
  };
  full_.erase(std::remove_if(full_.begin(), full_.end(), done), full_.end());
  return thinned;
}

}  // namespace kys_slam
