// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <deque>
#include <utility>

#include "matching/landmark_search.h"
#include "tracking/pose_estimation.h"
#include "tracking/pose_sources.h"

namespace kys_slam {
namespace {

/// The stereo points of the last frame where a camera at `T_c_w` sees them.
struct PointQueries {
  std::vector<SearchQuery> queries;
  std::vector<Eigen::Vector3d> points;  // m, in the world
  std::vector<LandmarkId> landmarks;    // invalid: none
  std::deque<kys::Prior> priors;
};

PointQueries points_at(const TrackingContext& c, const Rigid3& T_c_w) {
  const FrameFeatures& last = *c.last->features;
  const Rigid3 T_w_last = c.last->T_c_w.inverse();
  const float radius = static_cast<float>(c.motion.options().max_steps) * c.options.motion_radius;
  PointQueries result;
  for (std::size_t i = 0; i < last.size(); ++i) {
    if (!last.has_stereo(i)) continue;
    const Keypoint& seen = last.keypoint(i);
    const Eigen::Vector3d p_w = T_w_last * c.camera.back_project(seen.x, seen.y, last.depth(i));
    const Eigen::Vector3d p_c = T_c_w * p_w;
    if (p_c.z() <= 0) continue;
    const Eigen::Vector3d pixel = c.camera.project_stereo(p_c);
    if (!c.camera.in_image(pixel.x(), pixel.y())) continue;
    SearchQuery query = query_for_feature(last, i, pixel, c.scales);
    query.radius = radius * c.scales.scale[seen.octave];
    query.min_octave = 0;
    query.max_octave = c.scales.levels() - 1;
    query.prior = &result.priors.emplace_back(c.beliefs.with_belief(last.prior(i)));
    result.queries.push_back(query);
    result.points.push_back(p_w);
    result.landmarks.push_back(c.last->landmarks[i]);
  }
  return result;
}

}  // namespace

Attempt PointSource::find(const TrackingContext& c, const TrackedFrame& frame) const {
  const ExpectedPose expected = *c.motion.expected(frame.taken);
  Attempt attempt;
  const PointQueries wanted = points_at(c, expected.T_c_w);
  SearchOptions options;
  options.max_distance = c.options.max_distance;
  options.check_rotation = true;
  const std::vector<SearchMatch> matches = search_features(
      *frame.features, c.scales, wanted.queries, options, c.model, attempt.statistics);

  std::vector<PoseObservation> observations;
  std::vector<Vote> votes;
  std::vector<std::pair<std::size_t, LandmarkId>> matched;  // feature, its landmark if it has one
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    const auto i = static_cast<std::size_t>(matches[q].feature);
    const kys::Prior& prior = frame.features->prior(i);
    const kys::Prior& before = *wanted.queries[q].prior;
    observations.push_back(observation_of(c, *frame.features, i, wanted.points[q], 1));
    observations.back().share = std::min(c.beliefs.weight(before), c.beliefs.weight(prior));
    if (c.options.consensus.by_class) votes.push_back(c.beliefs.vote(prior, before));
    matched.emplace_back(i, wanted.landmarks[q]);
  }
  const ConsensusResult found =
      estimate_pose(c.camera, expected.T_c_w, observations, votes, expected, c.options.consensus);
  PoseCandidate& candidate = attempt.candidate;
  candidate.source = PoseSource::kPoints;
  candidate.T_c_w = found.pose.T_c_w;
  candidate.overruled = found.overruled;
  candidate.evidence.matches = static_cast<int>(matched.size());
  candidate.evidence.inliers = found.pose.inliers;
  if (found.pose.inliers < c.options.min_pose_inliers ||
      !c.motion.is_near(candidate.T_c_w, frame.taken, c.options.consensus.max_acceleration)) {
    attempt.failure = std::to_string(found.pose.inliers) + " inliers";
    return attempt;
  }
  candidate.landmarks.resize(frame.landmarks.size());
  for (std::size_t k = 0; k < matched.size(); ++k) {
    if (found.pose.outlier[k] == 0) candidate.landmarks[matched[k].first] = matched[k].second;
  }
  return attempt;
}

}  // namespace kys_slam
