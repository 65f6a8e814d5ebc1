// SPDX-License-Identifier: BSD-3-Clause
// Landmarks, and who observes them.
#include <kys/hamming.h>
#include <kys/prior.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "map/map.h"

namespace kys_slam {

namespace {

/// Index of the observation whose descriptor has the least median distance to all of them.
/// \param distances scratch
std::size_t representative(std::span<const kys::Descriptor* const> descriptors,
                           std::vector<std::uint16_t>& distances) {
  const std::size_t n = descriptors.size();
  if (n <= 2) return 0;
  distances.resize(n * n);
  for (std::size_t i = 0; i < n; ++i) {
    distances[i * n + i] = 0;
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

int Map::observation_weight(LandmarkId id) const {
  int weight = 0;
  for (const Observation& o : landmark(id).observations) {
    weight += keyframe(o.keyframe).features->has_stereo(o.feature) ? 2 : 1;
  }
  return weight;
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
  compared_.clear();
  for (const Observation& o : landmark.observations) {
    compared_.push_back(&keyframe(o.keyframe).features->descriptor(o.feature));
    __builtin_prefetch(compared_.back());
  }
  const Observation& best = landmark.observations[representative(compared_, distances_)];
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

void Map::refresh_geometry(LandmarkId id) {
  Landmark& landmark = landmarks_.at(id);
  if (landmark.observations.empty()) return;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  const Observation* reference = &landmark.observations.front();
  for (const Observation& o : landmark.observations) {
    sum += (landmark.p_w - keyframe(o.keyframe).centre).normalized();
    if (o.keyframe == landmark.reference) reference = &o;
  }
  landmark.normal = sum.normalized().cast<float>();
  const KeyFrame& from = keyframe(reference->keyframe);
  const int octave = from.features->keypoint(reference->feature).octave;
  const double distance = (landmark.p_w - from.centre).norm();
  const ScaleLevels::DistanceRange range = scales_.distance_range(distance, octave);
  landmark.min_distance = range.min;
  landmark.max_distance = range.max;
  touch_geometry(id);
}

void Map::refresh_geometry(std::span<const LandmarkId> ids) {
  for (const LandmarkId id : ids) {
    if (has(id)) refresh_geometry(id);
  }
}

}  // namespace kys_slam
