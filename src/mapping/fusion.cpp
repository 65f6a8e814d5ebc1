// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/fusion.h"

#include <algorithm>

#include "map/seen_landmarks.h"
#include "matching/landmark_search.h"
#include "matching/predicted_view.h"

namespace kys_slam {

void describe(kys::OptionList& list, FusionOptions& o, std::string_view prefix) {
  const auto key = [&](const char* name) { return std::string(prefix) + name; };
  list.add(key("fusion_neighbours"), o.neighbours, {0, 1000}, "", "covisible keyframes for fusion");
  list.add(key("fusion_second_neighbours"), o.second_neighbours, {0, 1000}, "",
           "covisible keyframes of each of these");
  list.add(key("fusion_radius"), o.radius, {0.1, 1000}, "px",
           "search radius, octave 0; the 95 % bound of the noise holds as well");
  list.add(key("fusion_distance"), o.max_distance, {0, 1e6}, "bits", "largest distance of a match");
}

namespace {

/// Keyframes to fuse with: the best covisible ones and their own. One that observes nothing that
/// others do (its pose was wrong) has its parent for that.
std::vector<KeyFrameId> fusion_targets(const Map& map, KeyFrameId current,
                                       const FusionOptions& options) {
  std::vector<KeyFrameId> targets = map.best_covisible(current, options.neighbours);
  const KeyFrameId parent = map.keyframe(current).parent;
  if (targets.empty() && map.has(parent)) targets.push_back(parent);
  const std::size_t first = targets.size();
  for (std::size_t k = 0; k < first; ++k) {
    if (options.second_neighbours == 0) break;
    for (const KeyFrameId id : map.best_covisible(targets[k], options.second_neighbours)) {
      if (id != current && std::find(targets.begin(), targets.end(), id) == targets.end()) {
        targets.push_back(id);
      }
    }
  }
  return targets;
}

bool is_seen_by(const Landmark& landmark, KeyFrameId keyframe) {
  return std::any_of(landmark.observations.begin(), landmark.observations.end(),
                     [&](const Observation& o) { return o.keyframe == keyframe; });
}

}  // namespace

int fuse_into(Map& map, KeyFrameId keyframe_id, const std::vector<LandmarkId>& landmarks,
              const FusionOptions& options, const kys::DistanceModel& model,
              kys::Statistics& statistics) {
  const KeyFrame& keyframe = map.keyframe(keyframe_id);
  const Eigen::Vector3d centre = keyframe.T_c_w.inverse_t();
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> asked;
  for (const LandmarkId id : landmarks) {
    if (!map.has(id)) continue;
    const Landmark& landmark = map.landmark(id);
    const auto view = predict_view(map.camera(), map.scales(), keyframe.T_c_w, centre, landmark);
    if (!view || is_seen_by(landmark, keyframe_id)) continue;
    queries.push_back(
        query_for(*view, options.radius, map.scales(), landmark.descriptor, landmark.prior));
    asked.push_back(id);
  }
  SearchOptions search;
  search.max_distance = options.max_distance;
  search.check_error = true;
  const std::vector<SearchMatch> matches =
      search_features(*keyframe.features, map.scales(), queries, search, model, statistics);
  int fused = 0;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0 || !map.has(asked[q])) continue;
    const auto feature = static_cast<std::uint32_t>(matches[q].feature);
    const LandmarkId there = map.keyframe(keyframe_id).landmarks[feature];
    if (!there.valid()) {
      if (map.add_observation(asked[q], keyframe_id, feature)) {
        map.refresh_landmark(asked[q]);
        ++fused;
      }
      continue;
    }
    if (there == asked[q]) continue;
    const bool keep_asked = map.observation_weight(asked[q]) > map.observation_weight(there);
    map.replace_landmark(keep_asked ? there : asked[q], keep_asked ? asked[q] : there);
    ++fused;
  }
  return fused;
}

int fuse_landmarks(Map& map, KeyFrameId current, const FusionOptions& options,
                   const kys::DistanceModel& model, kys::Statistics& statistics) {
  const std::vector<KeyFrameId> targets = fusion_targets(map, current, options);
  int fused = 0;
  const std::vector<LandmarkId> own = landmarks_seen_by(map, {current});
  for (const KeyFrameId target : targets) {
    fused += fuse_into(map, target, own, options, model, statistics);
  }
  const std::vector<LandmarkId> theirs = landmarks_seen_by(map, targets);
  return fused + fuse_into(map, current, theirs, options, model, statistics);
}

}  // namespace kys_slam
