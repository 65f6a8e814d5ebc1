// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/local_map_pose.h"

#include <algorithm>
#include <deque>

#include "matching/predicted_view.h"
#include "tracking/pose_estimation.h"

namespace kys_slam {
namespace {

/// Landmarks of the local map that should be in view and are not matched yet.
void match_local_landmarks(const TrackingContext& c, const TrackedFrame& frame,
                           const LocalMap& local, LocalMapPose& result) {
  PoseCandidate& candidate = result.candidate;
  std::vector<std::uint8_t> taken(candidate.landmarks.size(), 0);
  std::vector<LandmarkId> held;
  for (std::size_t i = 0; i < candidate.landmarks.size(); ++i) {
    if (!candidate.landmarks[i].valid()) continue;
    taken[i] = 1;
    held.push_back(candidate.landmarks[i]);
  }
  result.visible = held;
  std::sort(held.begin(), held.end());
  const Eigen::Vector3d centre = candidate.T_c_w.inverse_t();
  std::deque<kys::Prior> priors;
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> landmarks;
  c.replica.landmarks().visit(local.landmarks, [&](LandmarkId id, const LandmarkView& landmark) {
    const auto view = predict_view(c.camera, c.scales, candidate.T_c_w, centre, landmark);
    if (!view || std::binary_search(held.begin(), held.end(), id)) return;
    // The prediction is better when the angle between the two views is small.
    const float radius = (view->cosine > 0.998f ? 2.5f : 4.0f) * c.options.local_radius;
    queries.push_back(query_for(*view, radius, c.scales, landmark.descriptor,
                                *c.beliefs.of_landmark(landmark, priors)));
    landmarks.push_back(id);
    result.visible.push_back(id);
  });
  SearchOptions options;
  options.max_distance = c.options.max_distance;
  options.ratio = c.options.local_ratio;
  options.taken = taken;
  const std::vector<SearchMatch> matches =
      search_features(*frame.features, c.scales, queries, options, c.model, result.statistics);
  assign_matches(matches, landmarks, candidate.landmarks);
}

}  // namespace

LocalMapPose refine_with_local_map(const TrackingContext& c, const TrackedFrame& frame,
                                   PoseCandidate candidate, const LandmarkPatches& patches) {
  LocalMapPose result;
  result.candidate = std::move(candidate);
  PoseCandidate& pose = result.candidate;
  // Without landmarks the pose comes from other points of the last frame.
  const bool by_points = std::ranges::none_of(pose.landmarks, &LandmarkId::valid) && c.last;
  const LocalMap local =
      c.gatherer.gather(c.replica, by_points ? c.last->landmarks : pose.landmarks);
  result.reference = local.reference;
  match_local_landmarks(c, frame, local, result);
  result.features = frame.features;
  if (frame.left != nullptr) {
    result.features =
        patches.align(c.replica, pose.T_c_w, pose.landmarks, *frame.left, *frame.features);
  }
  estimate(c, *result.features, frame.taken, pose);
  std::ranges::copy_if(pose.landmarks, std::back_inserter(result.found), &LandmarkId::valid);
  return result;
}

}  // namespace kys_slam
