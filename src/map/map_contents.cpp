// SPDX-License-Identifier: BSD-3-Clause
#include "map/map_contents.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "map/map.h"

namespace kys_slam {

namespace {

/// Of a legitimate map every feature adds a few to the covisibility graph; beyond this many per
/// feature (and a start) the graph would outgrow the map by far.
constexpr std::uint64_t kPairsPerFeature = 256;
constexpr std::uint64_t kPairsAtLeast = std::uint64_t{1} << 20;

[[noreturn]] void fail(const std::string& what) {
  throw std::invalid_argument(what);
}
std::string name(KeyFrameId id) {
  return "keyframe " + std::to_string(id.value);
}
std::string name(LandmarkId id) {
  return "landmark " + std::to_string(id.value);
}

/// Ids increase and stay below `end`.
template <typename T>
void check_ids(const std::vector<T>& objects, std::uint32_t end) {
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (objects[i].id.value >= end) fail(name(objects[i].id) + " is beyond the ids ever used");
    if (i > 0 && !(objects[i - 1].id < objects[i].id))
      fail(name(objects[i].id) + " is out of order");
  }
}

void check_shared(const MapContents& contents) {
  if (!contents.camera.is_valid()) fail("its camera makes no sense");
  if (contents.scales.scale.empty()) fail("it has no scale levels");
  for (const float s : contents.scales.scale) {
    if (!(s > 0) || !std::isfinite(s)) fail("a scale level is not a positive number");
  }
  if (!std::isfinite(contents.scales.log_factor)) fail("the scale factor is not finite");
  if (!contents.rig.correction.parameters().allFinite() || !contents.rig.covariance.allFinite()) {
    fail("the correction of its cameras is not finite");
  }
  // The largest number means "none".
  if (contents.keyframe_id_end == KeyFrameId::kNone ||
      contents.landmark_id_end == LandmarkId::kNone) {
    fail("it has used up its ids");
  }
}

void check_features(const KeyFrame& keyframe, const MapContents& contents) {
  if (!keyframe.features) fail(name(keyframe.id) + " has no features");
  if (keyframe.features->rig() != contents.rig.correction) {
    fail(name(keyframe.id) + " has another correction of the cameras than the map");
  }
  const auto levels = contents.scales.scale.size();
  for (const Keypoint& k : keyframe.features->keypoints()) {
    if (k.octave >= levels)
      fail(name(keyframe.id) + " has a feature on an octave that is not there");
  }
}

}  // namespace

bool MapContents::has_priors() const {
  return std::any_of(keyframes.begin(), keyframes.end(),
                     [](const KeyFrame& k) { return !k.features->priors().empty(); }) ||
         std::any_of(landmarks.begin(), landmarks.end(),
                     [](const Landmark& l) { return l.prior != kys::Prior{}; });
}

MapContents Map::contents() const {
  MapContents contents{camera_,           scales_,           rig_,          {}, {}, {},
                       keyframe_id_end(), landmark_id_end(), keeps_beliefs_};
  contents.keyframes.reserve(keyframes_.size());
  keyframes_.for_each([&](KeyFrameId id, const KeyFrame& k) {
    contents.keyframes.push_back({.id = id,
                                  .submap = k.submap,
                                  .frame_index = k.frame_index,
                                  .timestamp = k.timestamp,
                                  .T_c_w = k.T_c_w,
                                  .centre = k.centre,
                                  .features = k.features,
                                  .landmarks = {},
                                  .covisible = {},
                                  .parent = k.parent,
                                  .children = {},
                                  .loop_edges = k.loop_edges,
                                  .motion = {}});
  });
  contents.culled.reserve(culled_.size());
  culled_.for_each([&](KeyFrameId, const CulledKeyFrame& c) { contents.culled.push_back(c); });
  contents.landmarks.reserve(landmarks_.size());
  landmarks_.for_each([&](LandmarkId, const Landmark& l) { contents.landmarks.push_back(l); });
  return contents;
}

Map::Map(MapContents contents)
    : camera_(contents.camera), scales_(contents.scales), rig_(contents.rig) {
  check_shared(contents);
  check_ids(contents.keyframes, contents.keyframe_id_end);
  check_ids(contents.culled, contents.keyframe_id_end);
  check_ids(contents.landmarks, contents.landmark_id_end);
  for (const KeyFrame& k : contents.keyframes) check_features(k, contents);
  keyframes_.skip_ids(contents.keyframe_id_end);
  landmarks_.skip_ids(contents.landmark_id_end);
  restore_keyframes(std::move(contents.keyframes));
  restore_tree();
  restore_culled(contents.culled);
  restore_landmarks(std::move(contents.landmarks));
  restore_covisibility();
  if (contents.beliefs) keep_beliefs();
  check_consistency();
}

void Map::restore_keyframes(std::vector<KeyFrame> keyframes) {
  for (KeyFrame& k : keyframes) {
    k.centre = k.T_c_w.inverse_t();
    k.landmarks.assign(k.features->size(), LandmarkId{});
    k.covisible.clear();
    k.children.clear();
    const KeyFrameId id = k.id;
    keyframes_.put(id, std::move(k));
    touch(id);
  }
}

/// Children from parents, and loop edges that both ends know.
void Map::restore_tree() {
  for (const KeyFrameId id : keyframes_.ids()) {
    const KeyFrame& k = keyframe(id);
    if (k.parent.valid()) {
      if (!has(k.parent) || k.parent == id) fail(name(id) + " has an absent parent");
      keyframes_.at(k.parent).children.push_back(id);  // by id, as the outer loop runs
    }
    for (std::size_t i = 0; i < k.loop_edges.size(); ++i) {
      const KeyFrameId other = k.loop_edges[i];
      if (i > 0 && !(k.loop_edges[i - 1] < other)) fail(name(id) + " has loop edges out of order");
      if (!has(other) || other == id) fail(name(id) + " has a loop edge to an absent keyframe");
      const auto& back = keyframe(other).loop_edges;
      if (!std::binary_search(back.begin(), back.end(), id)) {
        fail(name(other) + " does not know its loop edge to " + name(id));
      }
    }
  }
}

/// Every culled keyframe hangs, perhaps through others, on one that is alive.
void Map::restore_culled(const std::vector<CulledKeyFrame>& culled) {
  for (const CulledKeyFrame& c : culled) {
    if (has(c.id)) fail(name(c.id) + " is both alive and culled");
    if (!c.T_c_parent.is_finite())
      fail("culled " + name(c.id) + " has a motion that is not finite");
    culled_.put(c.id, c);
    newly_culled_.push_back(c);
  }
  std::vector<std::uint8_t> reaches(culled_.id_end(), 0);
  std::vector<KeyFrameId> path;
  for (const CulledKeyFrame& c : culled) {
    path.clear();
    KeyFrameId id = c.id;
    while (!has(id) && reaches[id.value] == 0) {
      path.push_back(id);
      id = culled_.at(id).parent;
      if (!has(id) && !culled_.contains(id)) fail("culled " + name(c.id) + " has an absent parent");
      if (path.size() > culled.size()) fail("culled " + name(c.id) + " is its own ancestor");
    }
    for (const KeyFrameId passed : path) reaches[passed.value] = 1;
  }
}

void Map::restore_landmarks(std::vector<Landmark> landmarks) {
  std::uint64_t features = 0;
  std::uint64_t pairs = 0;
  keyframes_.for_each([&](KeyFrameId, const KeyFrame& k) { features += k.landmarks.size(); });
  for (Landmark& l : landmarks) {
    const LandmarkId id = l.id;
    for (std::size_t i = 0; i < l.observations.size(); ++i) {
      const Observation& o = l.observations[i];
      KeyFrame* k = keyframes_.find(o.keyframe);
      if (k == nullptr) fail(name(id) + " is seen by an absent " + name(o.keyframe));
      if (i > 0 && !(l.observations[i - 1].keyframe < o.keyframe)) {
        fail(name(id) + " has observations out of order");
      }
      if (o.feature >= k->landmarks.size()) fail(name(id) + " is seen by an absent feature");
      if (k->landmarks[o.feature].valid()) fail(name(id) + " is seen by a feature of another one");
      k->landmarks[o.feature] = id;
      pairs += i;
    }
    landmarks_.put(id, std::move(l));
    touch(id);
  }
  if (pairs > kPairsAtLeast + kPairsPerFeature * features) {
    fail("its keyframes share more than a map of this size can");
  }
}

void Map::restore_covisibility() {
  std::vector<int> shared(keyframes_.id_end(), 0);
  std::vector<KeyFrameId> others;
  for (const KeyFrameId id : keyframes_.ids()) {
    KeyFrame& k = keyframes_.at(id);
    others.clear();
    for (const LandmarkId landmark_id : k.landmarks) {
      if (!landmark_id.valid()) continue;
      for (const Observation& o : landmark(landmark_id).observations) {
        if (o.keyframe != id && shared[o.keyframe.value]++ == 0) others.push_back(o.keyframe);
      }
    }
    std::sort(others.begin(), others.end());
    for (const KeyFrameId other : others) {
      k.covisible.push_back({other, shared[other.value]});
      shared[other.value] = 0;
    }
  }
}

}  // namespace kys_slam
