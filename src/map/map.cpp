// SPDX-License-Identifier: BSD-3-Clause
#include "map/map.h"

#include <kys/hamming.h>
#include <kys/prior.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>

#include "map/sort_ids.h"

namespace kys_slam {

Map::Map(const StereoCamera& camera, const ScaleLevels& scales)
    : camera_(camera), scales_(scales) {}

std::uint32_t Map::keyframe_id_end() const {
  return std::max(keyframes_.id_end(), culled_.id_end());
}

std::vector<KeyFrameId> Map::best_covisible(KeyFrameId id, std::size_t count,
                                            int min_weight) const {
  std::vector<Covisible> all = keyframe(id).covisible;
  const auto heavier = [](const Covisible& a, const Covisible& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.keyframe < b.keyframe;
  };
  const auto end = all.begin() + static_cast<std::ptrdiff_t>(std::min(count, all.size()));
  std::partial_sort(all.begin(), end, all.end(), heavier);
  std::vector<KeyFrameId> best;
  for (const Covisible& c : all) {
    if (best.size() >= count || (c.weight < min_weight && !best.empty())) break;
    best.push_back(c.keyframe);
  }
  return best;
}

std::optional<Rigid3> Map::pose(KeyFrameId id) const {
  Rigid3 T_c_k;  // from the keyframe reached so far to the requested one
  while (!keyframes_.contains(id)) {
    const CulledKeyFrame* culled = culled_.find(id);
    if (culled == nullptr) return std::nullopt;
    T_c_k = T_c_k * culled->T_c_parent;
    id = culled->parent;
  }
  return T_c_k * keyframe(id).T_c_w;
}

KeyFrameId Map::submap(KeyFrameId id) const {
  while (!keyframes_.contains(id)) {
    const CulledKeyFrame* culled = culled_.find(id);
    if (culled == nullptr) return {};
    id = culled->parent;
  }
  return keyframe(id).submap;
}

std::vector<KeyFrameId> Map::submap_keyframes(KeyFrameId submap) const {
  std::vector<KeyFrameId> members;
  keyframes_.for_each([&](KeyFrameId id, const KeyFrame& k) {
    if (k.submap == submap) members.push_back(id);
  });
  return members;
}

KeyFrameId Map::largest_submap() const {
  std::map<KeyFrameId, std::size_t> sizes;
  keyframes_.for_each([&](KeyFrameId, const KeyFrame& k) { ++sizes[k.submap]; });
  const auto largest = std::ranges::max_element(
      sizes, {}, [](const auto& submap) { return submap.second; });  // of equals the first
  return largest != sizes.end() ? largest->first : KeyFrameId{};
}

void Map::add_keyframe(KeyFrame keyframe) {
  if (!keyframe.features) throw std::logic_error("keyframe without features");
  const KeyFrameId id = keyframe.id;
  if (!keyframe.submap.valid()) keyframe.submap = id;
  if (keyframes_.empty() && keyframe_id_end() == 0) rig_.correction = keyframe.features->rig();
  if (keyframe.features->rig() != rig()) {
    keyframe.features = std::make_shared<const FrameFeatures>(keyframe.features->with_rig(rig()));
  }
  keyframe.centre = keyframe.T_c_w.inverse_t();
  keyframe.landmarks.assign(keyframe.features->size(), LandmarkId{});
  keyframe.covisible.clear();
  keyframe.children.clear();
  keyframe.loop_edges.clear();
  keyframe.parent = {};
  keyframes_.put(id, std::move(keyframe));
  touch(id);
}

void Map::connect_to_spanning_tree(KeyFrameId id, KeyFrameId otherwise) {
  KeyFrameId parent = otherwise;
  int best_weight = 0;
  for (const Covisible& c : keyframe(id).covisible) {
    if (c.keyframe < id && c.weight >= best_weight) {
      parent = c.keyframe;
      best_weight = c.weight;
    }
  }
  if (!has(parent) || parent == id) return;
  if (const KeyFrameId before = keyframe(id).parent; before.valid()) {
    erase_sorted(keyframes_.at(before).children, id);
    touch(before);
  }
  keyframes_.at(id).parent = parent;
  keyframes_.at(id).submap = keyframe(parent).submap;
  insert_sorted(keyframes_.at(parent).children, id);
  touch(id);
  touch(parent);
}

void Map::add_loop_edge(KeyFrameId a, KeyFrameId b) {
  insert_sorted(keyframes_.at(a).loop_edges, b);
  insert_sorted(keyframes_.at(b).loop_edges, a);
}

void Map::set_pose(KeyFrameId id, const Rigid3& T_c_w) {
  KeyFrame& keyframe = keyframes_.at(id);
  keyframe.T_c_w = T_c_w;
  keyframe.centre = T_c_w.inverse_t();
  touch(id);
}

void Map::move_keyframes(const std::vector<KeyFrameId>& ids, const std::vector<Rigid3>& T_c_w) {
  moved_ = true;
  IdTable<KeyFrameId, Rigid3> T_new_old;  // of world points seen from each
  for (std::size_t k = 0; k < ids.size(); ++k) {
    T_new_old.put(ids[k], T_c_w[k].inverse() * keyframe(ids[k]).T_c_w);
    set_pose(ids[k], T_c_w[k]);
  }
  for (const LandmarkId id : landmarks_.ids()) {
    Landmark& landmark = landmarks_.at(id);
    if (const Rigid3* T = T_new_old.find(landmark.reference)) landmark.p_w = *T * landmark.p_w;
    const auto moved = [&](const Observation& o) { return T_new_old.contains(o.keyframe); };
    if (std::any_of(landmark.observations.begin(), landmark.observations.end(), moved)) {
      refresh_geometry(id);
    }
  }
}

void Map::join_submaps(KeyFrameId joint, KeyFrameId onto) {
  const KeyFrameId from = keyframe(joint).submap;
  const KeyFrameId into = keyframe(onto).submap;
  if (from == into) throw std::logic_error("the sub-maps to be joined are one");
  // The path from the joint to the root turns round.
  KeyFrameId child = joint;
  KeyFrameId new_parent = onto;
  while (child.valid()) {
    const KeyFrameId old_parent = keyframe(child).parent;
    if (old_parent.valid()) erase_sorted(keyframes_.at(old_parent).children, child);
    keyframes_.at(child).parent = new_parent;
    insert_sorted(keyframes_.at(new_parent).children, child);
    touch(new_parent);
    new_parent = child;
    child = old_parent;
  }
  for (const KeyFrameId id : submap_keyframes(from)) {
    keyframes_.at(id).submap = into;
    touch(id);
  }
}

void Map::set_rig(const RigEstimate& rig) {
  rig_ = rig;
  for (const KeyFrameId id : keyframes_.ids()) {
    KeyFrame& keyframe = keyframes_.at(id);
    keyframe.features =
        std::make_shared<const FrameFeatures>(keyframe.features->with_rig(rig.correction));
    touch(id);
  }
}

void Map::note_rescaling(double factor) {
  moved_ = true;
  scale_ *= factor;
  newly_culled_.clear();
  for (const KeyFrameId id : culled_.ids()) {
    culled_.at(id).T_c_parent.translation *= factor;
    newly_culled_.push_back(culled_.at(id));
  }
}

bool Map::cull_keyframe(KeyFrameId id) {
  const KeyFrame& culled = keyframe(id);
  if (!culled.parent.valid()) return false;
  const KeyFrameId grandparent = culled.parent;

  // Each child joins the heaviest covisible keyframe among the grandparent and the children that
  // have been placed already; one without such a neighbour joins the grandparent.
  std::vector<KeyFrameId> placed{grandparent};
  const std::vector<KeyFrameId> children = culled.children;
  erase_sorted(keyframes_.at(grandparent).children, id);
  for (const KeyFrameId child : children) {
    KeyFrameId parent = grandparent;
    int best_weight = 0;
    for (const Covisible& c : keyframe(child).covisible) {
      const bool candidate = std::find(placed.begin(), placed.end(), c.keyframe) != placed.end();
      if (candidate && c.weight > best_weight) {
        best_weight = c.weight;
        parent = c.keyframe;
      }
    }
    keyframes_.at(child).parent = parent;
    insert_sorted(keyframes_.at(parent).children, child);
    touch(child);
    touch(parent);
    placed.push_back(child);
  }
  // The parent takes the loop's edge: the two places stay tied to each other.
  const std::vector<KeyFrameId> loop_edges = culled.loop_edges;
  for (const KeyFrameId other : loop_edges) {
    erase_sorted(keyframes_.at(other).loop_edges, id);
    if (other != grandparent) add_loop_edge(grandparent, other);
  }

  const std::vector<LandmarkId> seen = culled.landmarks;
  for (const LandmarkId landmark : seen) {
    if (landmark.valid() && has(landmark)) remove_observation(landmark, id);
  }
  const CulledKeyFrame record{id, grandparent,
                              culled.T_c_w * keyframe(grandparent).T_c_w.inverse()};
  keyframes_.erase(id);
  culled_.put(id, record);
  newly_culled_.push_back(record);
  touch(grandparent);
  return true;
}

std::size_t Map::thin_keyframe(KeyFrameId id) {
  KeyFrame& keyframe = keyframes_.at(id);
  std::vector<std::uint8_t> keep(keyframe.landmarks.size());
  std::vector<LandmarkId> landmarks;
  landmarks.reserve(keep.size());
  for (std::size_t i = 0; i < keep.size(); ++i) {
    const LandmarkId landmark = keyframe.landmarks[i];
    if (!landmark.valid()) continue;
    keep[i] = 1;
    lower_observation(landmarks_.at(landmark).observations, id)->feature =
        static_cast<std::uint32_t>(landmarks.size());
    landmarks.push_back(landmark);
  }
  if (landmarks.size() == keep.size()) return 0;
  keyframe.features = std::make_shared<const FrameFeatures>(keyframe.features->subset(keep));
  landmarks.shrink_to_fit();
  keyframe.landmarks = std::move(landmarks);
  keyframe.covisible.shrink_to_fit();
  touch(id);
  return keep.size() - keyframe.landmarks.size();
}

}  // namespace kys_slam
