// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/culling.h"

#include <cstdint>
#include <vector>

namespace kys_slam {

void describe(kys::OptionList& list, LandmarkCullingOptions& o) {
  list.add("mapping.min_found_ratio", o.min_found_ratio, {0, 1}, "",
           "share of frames in view that must match a new landmark");
  list.add(
      "mapping.min_observation_weight", o.min_observation_weight, {0, 100}, "",
      "observations (stereo counts twice) that a landmark needs two keyframes after its creation");
}

void describe(kys::OptionList& list, KeyFrameCullingOptions& o) {
  list.add("mapping.redundant_share", o.redundant_share, {0, 1}, "",
           "share of redundant landmarks above which a keyframe is culled");
  list.add("mapping.redundant_observers", o.min_observers, {1, 1000}, "",
           "other keyframes that make a landmark redundant");
  const kys::OptionList::Fixed fixed(list);
  list.add("mapping.redundant_baselines", o.close_baselines, {1, 1e6}, "baselines");
}

int RecentLandmarks::cull(Map& map, KeyFrameId current, const LandmarkCullingOptions& options) {
  int erased = 0;
  std::size_t kept = 0;
  for (const LandmarkId id : recent_) {
    if (!map.has(id)) continue;
    const Landmark& landmark = map.landmark(id);
    const std::uint32_t age = current.value - landmark.first_keyframe.value;
    const bool rarely_found = landmark.found < options.min_found_ratio * landmark.visible;
    const bool poorly_seen =
        age >= 2 && map.observation_weight(id) < options.min_observation_weight;
    if (rarely_found || poorly_seen) {
      map.erase_landmark(id);
      ++erased;
    } else if (age < 3) {
      recent_[kept++] = id;
    }
  }
  recent_.resize(kept);
  return erased;
}

namespace {

/// Whether enough other keyframes see the landmark at the same or a finer scale.
bool seen_elsewhere(const Map& map, const Landmark& landmark, KeyFrameId keyframe, int octave,
                    int min_observers) {
  if (static_cast<int>(landmark.observations.size()) <= min_observers) return false;
  int observers = 0;
  for (const Observation& o : landmark.observations) {
    if (o.keyframe == keyframe) continue;
    if (map.keyframe(o.keyframe).features->keypoint(o.feature).octave > octave + 1) continue;
    if (++observers >= min_observers) return true;
  }
  return false;
}

/// Features of the keyframe that observe a close landmark.
std::vector<std::uint32_t> close_features(const Map& map, const KeyFrame& keyframe,
                                          const KeyFrameCullingOptions& options) {
  const double close_depth = options.close_baselines * map.camera().baseline;
  std::vector<std::uint32_t> close;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    if (!keyframe.landmarks[i].valid()) continue;
    const float depth = keyframe.features->depth(i);
    if (depth > 0 && depth <= close_depth) close.push_back(static_cast<std::uint32_t>(i));
  }
  return close;
}

bool is_redundant(const Map& map, KeyFrameId id, const KeyFrameCullingOptions& options) {
  const KeyFrame& keyframe = map.keyframe(id);
  const std::vector<std::uint32_t> close = close_features(map, keyframe, options);
  const double wanted = options.redundant_share * static_cast<double>(close.size());
  std::size_t redundant = 0;
  for (std::size_t k = 0; k < close.size(); ++k) {
    const std::size_t left = close.size() - k;
    if (static_cast<double>(redundant + left) <= wanted) return false;
    const std::uint32_t i = close[k];
    const int octave = keyframe.features->keypoint(i).octave;
    const Landmark& landmark = map.landmark(keyframe.landmarks[i]);
    if (seen_elsewhere(map, landmark, id, octave, options.min_observers)) ++redundant;
  }
  return static_cast<double>(redundant) > wanted;
}

}  // namespace

int cull_keyframes(Map& map, KeyFrameId current, const KeyFrameCullingOptions& options) {
  int culled = 0;
  for (const KeyFrameId id : map.best_covisible(current, map.keyframes().size())) {
    if (!is_redundant(map, id, options)) continue;
    culled += map.cull_keyframe(id) ? 1 : 0;
  }
  return culled;
}

}  // namespace kys_slam
