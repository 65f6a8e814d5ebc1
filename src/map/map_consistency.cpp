// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <stdexcept>
#include <string>

#include "map/map.h"

namespace kys_slam {

namespace {

/// What is wrong is put together from its parts only when it is.
template <typename... Parts>
void require(bool condition, const Parts&... parts) {
  if (condition) return;
  const auto text = [](const auto& part) {
    if constexpr (requires { part.value; }) {
      using Part = std::decay_t<decltype(part)>;
      const char* kind = std::is_same_v<Part, KeyFrameId> ? "keyframe " : "landmark ";
      return kind + std::to_string(part.value);
    } else {
      return std::string(part);
    }
  };
  throw std::logic_error("map is inconsistent: " + (text(parts) + ...));
}

void check_observations(const Map& map, LandmarkId id, const Landmark& landmark) {
  require(landmark.id == id, id, " is stored under another id");
  require(landmark.p_w.allFinite(), id, " is not finite");
  require(!landmark.observations.empty(), id, " is seen by nothing");
  bool sees_reference = false;
  for (std::size_t i = 0; i < landmark.observations.size(); ++i) {
    const Observation& o = landmark.observations[i];
    require(map.has(o.keyframe), id, " is seen by an absent ", o.keyframe);
    require(map.keyframe(o.keyframe).landmarks.at(o.feature) == id, o.keyframe,
            " does not know that it sees ", id);
    sees_reference |= o.keyframe == landmark.reference;
    require(i == 0 || landmark.observations[i - 1].keyframe < o.keyframe, id,
            " has observations out of order");
  }
  require(sees_reference, id, " is not seen by its reference");
}

/// Both directions of every observation, and the covisibility recounted from them. `shared` has a
/// zero for every keyframe id, before and after.
void check_observations(const Map& map, KeyFrameId id, const KeyFrame& k,
                        std::vector<int>& shared) {
  require(k.id == id, id, " is stored under another id");
  require(k.T_c_w.is_finite(), id, " has a pose that is not finite");
  require(k.centre == k.T_c_w.inverse_t(), id, " has the centre of another pose");
  require(k.landmarks.size() == k.features->size(), id, " has a list of wrong length");
  std::size_t neighbours = 0;
  for (std::size_t f = 0; f < k.landmarks.size(); ++f) {
    const LandmarkId l = k.landmarks[f];
    if (!l.valid()) continue;
    require(map.has(l), id, " sees an absent ", l);
    bool known = false;
    for (const Observation& o : map.landmark(l).observations) {
      known |= o.keyframe == id && o.feature == f;
      if (o.keyframe != id && shared[o.keyframe.value]++ == 0) ++neighbours;
    }
    require(known, l, " does not know that ", id, " sees it");
  }
  require(neighbours == k.covisible.size(), "covisibility edges of ", id, " are missing");
  for (std::size_t i = 0; i < k.covisible.size(); ++i) {
    const Covisible& c = k.covisible[i];
    require(i == 0 || k.covisible[i - 1].keyframe < c.keyframe, id,
            " has covisible keyframes out of order");
    require(c.weight > 0 && map.has(c.keyframe) && shared[c.keyframe.value] == c.weight,
            "wrong covisibility of ", id, " and ", c.keyframe);
    require(map.keyframe(c.keyframe).submap == k.submap, id,
            " shares landmarks with another sub-map");
    shared[c.keyframe.value] = 0;
  }
}

void check_relatives(const Map& map, KeyFrameId id, const KeyFrame& k) {
  if (k.parent.valid()) {
    require(map.has(k.parent), id, " has an absent parent");
    const auto& siblings = map.keyframe(k.parent).children;
    require(std::binary_search(siblings.begin(), siblings.end(), id), "the parent of ", id,
            " does not know it");
    require(map.keyframe(k.parent).submap == k.submap, id, " has a parent in another sub-map");
  }
  for (const KeyFrameId child : k.children) {
    require(map.has(child) && map.keyframe(child).parent == id, id, " has a wrong child ", child);
  }
  for (const KeyFrameId other : k.loop_edges) {
    require(map.has(other), id, " has a loop edge to an absent keyframe");
  }
}

/// Every keyframe hangs on the one root of its sub-map. Those found to do so are marked, so each is
/// passed once.
void check_ancestors(const Map& map) {
  std::vector<std::uint8_t> rooted(map.keyframes().id_end(), 0);
  std::vector<KeyFrameId> path;
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame&) {
    path.clear();
    for (KeyFrameId k = id; k.valid() && rooted[k.value] == 0; k = map.keyframe(k).parent) {
      require(path.size() < map.keyframes().size(), "the spanning tree has a cycle at ", id);
      path.push_back(k);
    }
    for (const KeyFrameId k : path) rooted[k.value] = 1;
  });
  std::vector<std::uint8_t> has_root(map.keyframe_id_end(), 0);  // by sub-map
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& k) {
    require(k.submap.value < has_root.size(), id, " belongs to no sub-map");
    if (k.parent.valid()) return;
    require(has_root[k.submap.value] == 0, "two roots in the sub-map of ", id);
    has_root[k.submap.value] = 1;
  });
}

}  // namespace

void Map::check_consistency() const {
  landmarks_.for_each(
      [&](LandmarkId id, const Landmark& landmark) { check_observations(*this, id, landmark); });
  std::vector<int> shared(keyframes_.id_end(), 0);
  keyframes_.for_each([&](KeyFrameId id, const KeyFrame& k) {
    check_observations(*this, id, k, shared);
    check_relatives(*this, id, k);
  });
  check_ancestors(*this);
}

}  // namespace kys_slam
