#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "map/map.h"

namespace kys_slam {

namespace {

void require(bool condition, const std::string& what) {
  if (!condition) throw std::logic_error("map is inconsistent: " + what);
}

std::string name(KeyFrameId id) {
  return "keyframe " + std::to_string(id.value);
}
std::string name(LandmarkId id) {
  return "landmark " + std::to_string(id.value);
}

}  // namespace

void Map::check_consistency() const {
  std::map<std::pair<KeyFrameId, KeyFrameId>, int> shared;
  landmarks_.for_each([&](LandmarkId id, const Landmark& landmark) {
    require(landmark.id == id, name(id) + " is stored under another id");
    require(landmark.p_w.allFinite(), name(id) + " is not finite");
    require(!landmark.observations.empty(), name(id) + " is seen by nothing");
    bool sees_reference = false;
    for (std::size_t i = 0; i < landmark.observations.size(); ++i) {
      const Observation& o = landmark.observations[i];
      require(has(o.keyframe), name(id) + " is seen by an absent " + name(o.keyframe));
      require(keyframe(o.keyframe).landmarks.at(o.feature) == id,
              name(o.keyframe) + " does not know that it sees " + name(id));
      sees_reference |= o.keyframe == landmark.reference;
      for (std::size_t j = 0; j < i; ++j) {
        require(landmark.observations[j].keyframe < o.keyframe,
                name(id) + " has observations out of order");
        ++shared[{landmark.observations[j].keyframe, o.keyframe}];
      }
    }
    require(sees_reference, name(id) + " is not seen by its reference");
  });

  std::vector<bool> has_root(keyframes_.id_end(), false);  // by sub-map
  std::size_t weights = 0;
  keyframes_.for_each([&](KeyFrameId id, const KeyFrame& k) {
    require(k.id == id, name(id) + " is stored under another id");
    require(k.T_c_w.is_finite(), name(id) + " has a pose that is not finite");
    require(k.landmarks.size() == k.features->size(), name(id) + " has a list of wrong length");
    for (std::size_t f = 0; f < k.landmarks.size(); ++f) {
      const LandmarkId l = k.landmarks[f];
      if (!l.valid()) continue;
      require(has(l), name(id) + " sees an absent " + name(l));
      bool known = false;
      for (const Observation& o : landmark(l).observations) {
        known |= o.keyframe == id && o.feature == f;
      }
      require(known, name(l) + " does not know that " + name(id) + " sees it");
    }
    for (const Covisible& c : k.covisible) {
      require(keyframe(c.keyframe).submap == k.submap,
              name(id) + " shares landmarks with another sub-map");
      const auto pair = std::minmax(id, c.keyframe);
      const auto found = shared.find({pair.first, pair.second});
      require(found != shared.end() && found->second == c.weight,
              "wrong covisibility of " + name(id) + " and " + name(c.keyframe));
      ++weights;
    }
    require(k.submap.valid() && k.submap.value < keyframes_.id_end(),
            name(id) + " belongs to no sub-map");
    if (!k.parent.valid()) {
      require(!has_root[k.submap.value], "two roots in the sub-map of " + name(id));
      has_root[k.submap.value] = true;
    }
    if (k.parent.valid()) {
      require(has(k.parent), name(id) + " has an absent parent");
      require(keyframe(k.parent).submap == k.submap,
              name(id) + " has a parent in another sub-map");
      const auto& siblings = keyframe(k.parent).children;
      require(std::binary_search(siblings.begin(), siblings.end(), id),
              "the parent of " + name(id) + " does not know it");
      // Every keyframe is younger than the root it reaches, in fewer steps than there are
      // keyframes.
      KeyFrameId ancestor = id;
      for (std::size_t steps = 0; keyframe(ancestor).parent.valid(); ++steps) {
        require(steps <= keyframes_.size(), "the spanning tree has a cycle at " + name(id));
        ancestor = keyframe(ancestor).parent;
      }
    }
    for (const KeyFrameId child : k.children) {
      require(has(child) && keyframe(child).parent == id,
              name(id) + " has a wrong child " + name(child));
    }
    for (const KeyFrameId other : k.loop_edges) {
      require(has(other), name(id) + " has a loop edge to an absent keyframe");
    }
  });
  require(weights == 2 * shared.size(), "covisibility edges are missing");
  keyframes_.for_each([&](KeyFrameId id, const KeyFrame& k) {
    require(has_root[k.submap.value], "the sub-map of " + name(id) + " has no root");
  });
}

}  // namespace kys_slam
