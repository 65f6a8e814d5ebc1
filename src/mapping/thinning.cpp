#include "mapping/thinning.h"

#include <algorithm>

namespace kys_slam {

void describe(kys::OptionList& list, ThinningOptions& o) {
  list.add("mapping.thin_after", o.patience, {0, 1e9}, "keyframes",
           "since one last shared landmarks with the newest, after which it keeps no features "
           "without landmark; 0: never");
}

void Thinning::continue_map(const Map& map) {
  whole_.clear();
  const KeyFrameId now{map.keyframe_id_end()};
  for (const KeyFrameId id : map.keyframes().ids()) whole_.push_back({id, now});
}

int Thinning::update(Map& map, KeyFrameId current) {
  if (options_.patience <= 0 || !map.has(current)) return 0;
  whole_.push_back({current, current});
  const std::vector<Covisible>& near = map.keyframe(current).covisible;
  const auto sees = [&](KeyFrameId id) {
    const auto at =
        std::lower_bound(near.begin(), near.end(), id,
                         [](const Covisible& c, KeyFrameId wanted) { return c.keyframe < wanted; });
    return at != near.end() && at->keyframe == id;
  };
  int thinned = 0;
  const auto done = [&](Whole& whole) {
    if (!map.has(whole.keyframe)) return true;
    if (sees(whole.keyframe)) whole.last_use = current;
    const std::uint32_t unused = current.value - whole.last_use.value;
    if (unused < static_cast<std::uint32_t>(options_.patience)) return false;
    thinned += map.thin_keyframe(whole.keyframe) > 0 ? 1 : 0;
    return true;
  };
  whole_.erase(std::remove_if(whole_.begin(), whole_.end(), done), whole_.end());
  return thinned;
}

}  // namespace kys_slam
