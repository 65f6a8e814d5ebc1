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

namespace {

template <typename IdType>
void insert_sorted(std::vector<IdType>& ids, IdType id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at == ids.end() || *at != id) ids.insert(at, id);
}

template <typename IdType>
void erase_sorted(std::vector<IdType>& ids, IdType id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at != ids.end() && *at == id) ids.erase(at);
}

std::vector<Observation>::iterator lower_observation(std::vector<Observation>& observations,
                                                     KeyFrameId keyframe) {
  return std::lower_bound(
      observations.begin(), observations.end(), keyframe,
      [](const Observation& o, KeyFrameId wanted) { return o.keyframe < wanted; });
}

/// Index of the observation whose descriptor has the least median distance to all of them.
std::size_t representative(std::span<const kys::Descriptor* const> descriptors) {
  const std::size_t n = descriptors.size();
  if (n <= 2) return 0;
  std::vector<std::uint16_t> distances(n * n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      distances[i * n + j] = distances[j * n + i] =
          static_cast<std::uint16_t>(kys::hamming(*descriptors[i], *descriptors[j]));
    }
  }
  const auto middle = static_cast<std::ptrdiff_t>((n - 1) / 2);
  std::size_t best = 0;
  std::uint16_t best_median = std::numeric_limits<std::uint16_t>::max();
  for (std::size_t i = 0; i < n; ++i) {
    const auto row = std::span(distances).subspan(i * n, n);
    // A median is smaller when more than half of the row is: few rows need to be sorted.
    const auto is_smaller = [&](std::uint16_t distance) { return distance < best_median; };
    if (std::ranges::count_if(row, is_smaller) <= middle) continue;
    std::ranges::nth_element(row, row.begin() + middle);
    best_median = row[static_cast<std::size_t>(middle)];
    best = i;
  }
  return best;
}

}  // namespace

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

int Map::observation_weight(LandmarkId id) const {
  int weight = 0;
  for (const Observation& o : landmark(id).observations) {
    weight += keyframe(o.keyframe).features->has_stereo(o.feature) ? 2 : 1;
  }
  return weight;
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
  keyframes_.at(id).T_c_w = T_c_w;
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

void Map::add_landmark(Landmark landmark) {
  const LandmarkId id = landmark.id;
  landmark.observations.clear();
  landmarks_.put(id, std::move(landmark));
  index_instance(id);
  touch(id);
}

void Map::set_position(LandmarkId id, const Eigen::Vector3d& p_w) {
  landmarks_.at(id).p_w = p_w;
  touch_geometry(id);
}

void Map::add_visible(LandmarkId id, std::uint32_t visible, std::uint32_t found) {
  Landmark& landmark = landmarks_.at(id);
  landmark.visible = frame_count(std::uint64_t{landmark.visible} + visible);
  landmark.found = frame_count(std::uint64_t{landmark.found} + found);
}

void Map::change_covisibility(KeyFrameId a, KeyFrameId b, int by) {
  for (int side = 0; side < 2; ++side, std::swap(a, b)) {
    std::vector<Covisible>& list = keyframes_.at(a).covisible;
    const auto at =
        std::lower_bound(list.begin(), list.end(), b,
                         [](const Covisible& c, KeyFrameId id) { return c.keyframe < id; });
    if (at == list.end() || at->keyframe != b) {
      list.insert(at, Covisible{b, by});
    } else if ((at->weight += by) == 0) {
      list.erase(at);
    }
    touch(a);
  }
}

bool Map::add_observation(LandmarkId landmark_id, KeyFrameId keyframe_id, std::uint32_t feature) {
  Landmark& landmark = landmarks_.at(landmark_id);
  KeyFrame& keyframe = keyframes_.at(keyframe_id);
  if (keyframe.landmarks.at(feature).valid()) return false;
  const auto at = lower_observation(landmark.observations, keyframe_id);
  if (at != landmark.observations.end() && at->keyframe == keyframe_id) return false;
  for (const Observation& other : landmark.observations) {
    change_covisibility(keyframe_id, other.keyframe, +1);
  }
  landmark.observations.insert(at, Observation{keyframe_id, feature});
  keyframe.landmarks[feature] = landmark_id;
  if (!landmark.reference.valid()) landmark.reference = keyframe_id;
  touch(landmark_id);
  touch(keyframe_id);
  return true;
}

void Map::remove_observation(LandmarkId landmark_id, KeyFrameId keyframe_id) {
  Landmark& landmark = landmarks_.at(landmark_id);
  const auto at = lower_observation(landmark.observations, keyframe_id);
  if (at == landmark.observations.end() || at->keyframe != keyframe_id) return;
  keyframes_.at(keyframe_id).landmarks[at->feature] = {};
  landmark.observations.erase(at);
  for (const Observation& other : landmark.observations) {
    change_covisibility(keyframe_id, other.keyframe, -1);
  }
  touch(landmark_id);
  touch(keyframe_id);
  if (landmark.reference == keyframe_id && !landmark.observations.empty()) {
    landmark.reference = landmark.observations.front().keyframe;
  }
  if (observation_weight(landmark_id) <= 2) erase_landmark(landmark_id);
}

void Map::erase_landmark(LandmarkId id) {
  const std::vector<Observation> observations = landmark(id).observations;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    keyframes_.at(observations[i].keyframe).landmarks[observations[i].feature] = {};
    touch(observations[i].keyframe);
    for (std::size_t j = 0; j < i; ++j) {
      change_covisibility(observations[i].keyframe, observations[j].keyframe, -1);
    }
  }
  landmarks_.erase(id);
  erased_landmarks_.push_back(id);
}

void Map::replace_landmark(LandmarkId from, LandmarkId into) {
  if (from == into) return;
  const Landmark old = landmark(from);
  erase_landmark(from);
  landmarks_.replace(from, into);
  replaced_.emplace_back(from, into);
  for (const Observation& o : old.observations) add_observation(into, o.keyframe, o.feature);
  add_visible(into, old.visible, old.found);
  refresh_landmark(into);
}

void Map::refresh_landmark(LandmarkId id) {
  Landmark& landmark = landmarks_.at(id);
  if (landmark.observations.empty()) return;
  std::vector<const kys::Descriptor*> descriptors;
  descriptors.reserve(landmark.observations.size());
  for (const Observation& o : landmark.observations) {
    descriptors.push_back(&keyframe(o.keyframe).features->descriptor(o.feature));
    __builtin_prefetch(descriptors.back());
  }
  const Observation& best = landmark.observations[representative(descriptors)];
  const Observation& recent = landmark.observations.back();
  landmark.descriptor = keyframe(best.keyframe).features->descriptor(best.feature);
  const std::int32_t instance_before = landmark.prior.instance;
  landmark.prior = kys::landmark_prior(keyframe(best.keyframe).features->prior(best.feature),
                                       keyframe(recent.keyframe).features->prior(recent.feature));
  if (landmark.prior.instance != instance_before) index_instance(id);
  if (const auto known = beliefs_.find(landmark.prior.instance); known != beliefs_.end()) {
    landmark.prior = kys::with_belief(landmark.prior, known->second.p_static);
  }
  touch(id);
  refresh_geometry(id);
}

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

/// \param centre_of camera centre (m, world) of a keyframe
template <typename CentreOf>
void Map::refresh_geometry(LandmarkId id, const CentreOf& centre_of) {
  Landmark& landmark = landmarks_.at(id);
  if (landmark.observations.empty()) return;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  const Observation* reference = &landmark.observations.front();
  for (const Observation& o : landmark.observations) {
    sum += (landmark.p_w - centre_of(o.keyframe)).normalized();
    if (o.keyframe == landmark.reference) reference = &o;
  }
  landmark.normal = sum.normalized().cast<float>();
  const KeyFrame& keyframe = keyframes_.at(reference->keyframe);
  const int octave = keyframe.features->keypoint(reference->feature).octave;
  const double distance = (landmark.p_w - centre_of(reference->keyframe)).norm();
  const ScaleLevels::DistanceRange range = scales_.distance_range(distance, octave);
  landmark.min_distance = range.min;
  landmark.max_distance = range.max;
  touch_geometry(id);
}

void Map::refresh_geometry(LandmarkId id) {
  refresh_geometry(id, [this](KeyFrameId k) { return keyframe(k).T_c_w.inverse_t(); });
}

void Map::refresh_geometry(std::span<const LandmarkId> ids) {
  std::vector<std::optional<Eigen::Vector3d>> centres(keyframes_.id_end());
  const auto centre_of = [&](KeyFrameId k) -> const Eigen::Vector3d& {
    std::optional<Eigen::Vector3d>& centre = centres[k.value];
    if (!centre) centre = keyframe(k).T_c_w.inverse_t();
    return *centre;
  };
  for (const LandmarkId id : ids) {
    if (has(id)) refresh_geometry(id, centre_of);
  }
}

LandmarkView Map::view(LandmarkId id) const {
  const Landmark& l = landmark(id);
  LandmarkView view{l.p_w, l.normal, l.min_distance, l.max_distance, l.prior, l.descriptor, {}};
  view.observers.reserve(l.observations.size());
  for (const Observation& o : l.observations) view.observers.push_back(o.keyframe);
  return view;
}

KeyFrameView Map::view(KeyFrameId id) const {
  const KeyFrame& k = keyframe(id);
  return {k.T_c_w,  k.features, k.landmarks, best_covisible(id, kViewNeighbours),
          k.parent, k.children, k.submap};
}

ChangeSet Map::take_changes() {
  ChangeSet changes;
  changes.rig = rig();
  const auto sigma = [&](RigParameter p) {
    return std::sqrt(rig_.covariance(static_cast<int>(p), static_cast<int>(p)));
  };
  changes.rig_sigma = {sigma(RigParameter::kOffset), sigma(RigParameter::kFocal)};
  changes.scale = scale_;
  changes.moved = std::exchange(moved_, false);
  sort_unique(dirty_landmarks_);
  changes.landmarks.reserve(dirty_landmarks_.size());
  for (const LandmarkId id : dirty_landmarks_) {
    if (has(id)) changes.landmarks.emplace_back(id, view(id));
  }
  sort_unique(moved_landmarks_);
  changes.moved_landmarks.reserve(moved_landmarks_.size());
  auto dirty = dirty_landmarks_.begin();
  for (const LandmarkId id : moved_landmarks_) {
    while (dirty != dirty_landmarks_.end() && *dirty < id) ++dirty;
    if ((dirty != dirty_landmarks_.end() && *dirty == id) || !has(id)) continue;
    const Landmark& l = landmark(id);
    changes.moved_landmarks.emplace_back(
        id, LandmarkGeometry{l.p_w, l.normal, l.min_distance, l.max_distance});
  }
  std::sort(dirty_keyframes_.begin(), dirty_keyframes_.end());
  for (const KeyFrameId id : dirty_keyframes_) {
    is_dirty_[id.value] = 0;
    if (has(id)) changes.keyframes.emplace_back(id, view(id));
  }
  std::sort(erased_landmarks_.begin(), erased_landmarks_.end());
  changes.erased_landmarks = std::move(erased_landmarks_);
  changes.replaced = std::move(replaced_);
  changes.culled_keyframes = std::move(newly_culled_);
  dirty_landmarks_ = {};  // may have had the whole map
  moved_landmarks_ = {};
  dirty_keyframes_.clear();
  erased_landmarks_.clear();
  replaced_.clear();
  newly_culled_.clear();
  return changes;
}

}  // namespace kys_slam
