#include "mapping/culling.h"

namespace kys_slam {

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
  int observers = 0;
  for (const Observation& o : landmark.observations) {
    if (o.keyframe == keyframe) continue;
    if (map.keyframe(o.keyframe).features->keypoint(o.feature).octave <= octave + 1) ++observers;
  }
  return observers >= min_observers;
}

bool is_redundant(const Map& map, KeyFrameId id, const KeyFrameCullingOptions& options) {
  const KeyFrame& keyframe = map.keyframe(id);
  const double close_depth = options.close_baselines * map.camera().baseline;
  int close = 0;
  int redundant = 0;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    const LandmarkId landmark = keyframe.landmarks[i];
    const float depth = keyframe.features->depth(i);
    if (!landmark.valid() || depth <= 0 || depth > close_depth) continue;
    ++close;
    const int octave = keyframe.features->keypoint(i).octave;
    redundant += seen_elsewhere(map, map.landmark(landmark), id, octave, options.min_observers);
  }
  return close > 0 && redundant > options.redundant_share * close;
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
