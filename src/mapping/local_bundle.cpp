// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/local_bundle.h"

#include <algorithm>
#include <cstdint>
#include <optional>

#include "map/seen_landmarks.h"

namespace kys_slam {

void describe(kys::OptionList& list, LocalBundleOptions& o) {
  list.add("mapping.bundle_keyframes", o.max_keyframes, {1, 1000}, "",
           "keyframes optimised together");
  list.add("mapping.bundle_fixed", o.max_fixed, {0, 10000}, "", "keyframes held fixed around them");
  describe(list, o.bundle, "mapping.bundle_");
}

namespace {

struct Window {
  std::vector<KeyFrameId> free;       // by id
  std::vector<KeyFrameId> fixed;      // by id
  std::vector<LandmarkId> landmarks;  // by id
  std::vector<LandmarkId> single;     // by id; the others, seen in stereo by one keyframe alone
};

/// A landmark's only view, in stereo, says nothing about its pose: as many numbers as unknowns. It
/// keeps its place in that view.
bool is_single(const Map& map, LandmarkId id) {
  const std::vector<Observation>& observations = map.landmark(id).observations;
  if (observations.size() != 1) return false;
  return map.keyframe(observations[0].keyframe).features->has_stereo(observations[0].feature);
}

Window choose_window(const Map& map, KeyFrameId current, const LocalBundleOptions& options) {
  Window window;
  window.free = map.best_covisible(current, options.max_keyframes - 1);
  window.free.push_back(current);
  std::sort(window.free.begin(), window.free.end());
  window.landmarks = landmarks_seen_by(map, window.free);
  const auto rest = std::stable_partition(window.landmarks.begin(), window.landmarks.end(),
                                          [&](LandmarkId id) { return !is_single(map, id); });
  window.single.assign(rest, window.landmarks.end());
  window.landmarks.erase(rest, window.landmarks.end());

  std::vector<int> shared(map.keyframe_id_end(), 0);  // landmarks, by keyframe
  for (const KeyFrameId id : window.free) shared[id.value] = -1;
  for (const LandmarkId landmark : window.landmarks) {
    for (const Observation& o : map.landmark(landmark).observations) {
      if (shared[o.keyframe.value] >= 0) ++shared[o.keyframe.value];
    }
  }
  std::vector<std::pair<int, KeyFrameId>> order;
  for (std::uint32_t id = 0; id < shared.size(); ++id) {
    if (shared[id] > 0) order.emplace_back(-shared[id], KeyFrameId{id});
  }
  std::sort(order.begin(), order.end());
  order.resize(std::min(order.size(), options.max_fixed));
  for (const auto& entry : order) window.fixed.push_back(entry.second);
  for (const KeyFrameId id : window.free) {  // what holds them
    const std::optional<ExpectedMotion>& motion = map.keyframe(id).motion;
    if (!motion || !map.has(motion->reference)) continue;
    if (std::binary_search(window.free.begin(), window.free.end(), motion->reference)) continue;
    if (std::ranges::find(window.fixed, motion->reference) != window.fixed.end()) continue;
    window.fixed.push_back(motion->reference);
  }
  std::sort(window.fixed.begin(), window.fixed.end());
  return window;
}

}  // namespace

std::vector<ObservationRef> add_landmarks(const Map& map, const std::vector<KeyFrameId>& poses,
                                          const std::vector<LandmarkId>& landmarks,
                                          BundleProblem& problem) {
  struct Pose {
    const FrameFeatures* features = nullptr;  // null: not among the poses
    std::uint32_t index = 0;
  };
  std::vector<Pose> pose_of(map.keyframe_id_end());
  for (std::uint32_t k = 0; k < poses.size(); ++k) {
    pose_of[poses[k].value] = {map.keyframe(poses[k]).features.get(), k};
  }
  if (!poses.empty()) {  // those of a run are all alike
    problem.ratio = map.keyframe(poses.back()).features->ratio();
  }
  std::vector<ObservationRef> observations;
  std::size_t most = 0;
  for (const LandmarkId id : landmarks) most += map.landmark(id).observations.size();
  observations.reserve(most);
  problem.observations.reserve(most);
  problem.points.reserve(landmarks.size());
  problem.first.reserve(landmarks.size() + 1);
  problem.inv_sigma = map.scales().inv_sigmas();
  if (map.keeps_beliefs()) problem.weights.reserve(landmarks.size());
  for (const LandmarkId id : landmarks) {
    const Landmark& landmark = map.landmark(id);
    if (map.keeps_beliefs()) problem.weights.push_back(map.weight(landmark));
    problem.add_point(landmark.p_w);
    for (const Observation& o : landmark.observations) {
      const Pose& pose = pose_of[o.keyframe.value];
      if (pose.features == nullptr) continue;
      const FrameFeatures& features = *pose.features;
      const Keypoint& k = features.keypoint(o.feature);
      const float u_right =
          features.has_stereo(o.feature) ? features.u_right(o.feature) : StereoPixel{}.u_right;
      problem.add_observation(
          {k.x, k.y, u_right, pose.index,
           static_cast<std::uint32_t>(features.noise(o.feature, map.scales()))});
      observations.push_back({id, o.keyframe, o.feature});
    }
  }
  return observations;
}

void add_motions(const Map& map, const std::vector<KeyFrameId>& poses, BundleProblem& problem) {
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const std::optional<ExpectedMotion>& motion = map.keyframe(poses[k]).motion;
    if (!motion) continue;
    const auto at = std::lower_bound(poses.begin(), poses.end(), motion->reference);
    if (at == poses.end() || *at != motion->reference) continue;
    problem.motions.push_back({static_cast<std::uint32_t>(k),
                               static_cast<std::uint32_t>(at - poses.begin()),
                               scaled(motion->T_c_reference, map.scale() / motion->scale),
                               motion->sigma_position, motion->sigma_rotation});
  }
}

LocalBundleReport adjust_locally(Map& map, KeyFrameId current, const LocalBundleOptions& options,
                                 const std::atomic<bool>* stop) {
  const Window window = choose_window(map, current, options);
  std::vector<KeyFrameId> poses = window.free;
  poses.insert(poses.end(), window.fixed.begin(), window.fixed.end());
  std::sort(poses.begin(), poses.end());

  BundleProblem problem;
  problem.camera = map.camera();
  std::size_t free_poses = 0;
  for (const KeyFrameId id : poses) {
    const KeyFrame& keyframe = map.keyframe(id);
    const bool in_window = std::binary_search(window.free.begin(), window.free.end(), id);
    const bool fixed = !in_window || !keyframe.parent.valid();  // a root holds its map in place
    problem.T_c_w.push_back(keyframe.T_c_w);
    problem.pose_fixed.push_back(fixed ? 1 : 0);
    free_poses += fixed ? 0 : 1;
  }
  if (free_poses == poses.size()) problem.pose_fixed.front() = 1;

  const std::vector<ObservationRef> observations =
      add_landmarks(map, poses, window.landmarks, problem);
  add_motions(map, poses, problem);

  BundleOptions bundle = options.bundle;
  bundle.stop = stop;
  const BundleSummary summary = adjust_bundle(problem, bundle);

  // While the map has the poses from before.
  for (const LandmarkId id : window.single) {
    const Landmark& landmark = map.landmark(id);
    const KeyFrameId seen_by = landmark.observations[0].keyframe;
    const auto k = static_cast<std::size_t>(std::lower_bound(poses.begin(), poses.end(), seen_by) -
                                            poses.begin());
    if (problem.pose_fixed[k] != 0) continue;
    map.set_position(id, problem.T_c_w[k].inverse() * (map.keyframe(seen_by).T_c_w * landmark.p_w));
  }
  for (std::size_t k = 0; k < poses.size(); ++k) {
    if (problem.pose_fixed[k] == 0) map.set_pose(poses[k], problem.T_c_w[k]);
  }
  for (std::size_t k = 0; k < window.landmarks.size(); ++k) {
    map.set_position(window.landmarks[k], problem.points[k]);
  }
  LocalBundleReport report;
  for (std::size_t k = 0; k < observations.size(); ++k) {
    if (summary.outlier[k] == 0) continue;
    ++report.outliers;
    if (map.has(observations[k].landmark))
      map.remove_observation(observations[k].landmark, observations[k].keyframe);
  }
  map.refresh_geometry(window.landmarks);
  map.refresh_geometry(window.single);
  report.keyframes = static_cast<int>(window.free.size());
  report.fixed = static_cast<int>(window.fixed.size());
  report.landmarks = static_cast<int>(window.landmarks.size() + window.single.size());
  report.observations = static_cast<int>(observations.size());
  report.iterations = summary.iterations;
  report.window = std::move(poses);
  return report;
}

}  // namespace kys_slam
