// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

// The pose of a frame from all stereo points of the last frame, most of which are no landmarks.

#include <algorithm>
#include <deque>
#include <utility>

namespace kys_slam {

/// When pictures are missing and the last frame was no keyframe, too few of its landmarks are seen
/// again, while its other stereo points are still in view. They are looked for where constant
/// velocity predicts them; points that are landmarks too become those of the frame.
bool Tracker::predict_by_points(Frame& frame, TrackResult& result) {
  const ExpectedPose expected = *expected_pose(frame.taken);
  const FrameFeatures& last = *last_->features;
  const Rigid3 T_w_last = last_->T_c_w.inverse();
  const float radius = kMostSteps * options_.motion_radius;
  std::deque<kys::Prior> priors;
  std::vector<SearchQuery> queries;
  std::vector<Eigen::Vector3d> points;  // m, in the world
  std::vector<LandmarkId> landmarks;    // invalid: none
  for (std::size_t i = 0; i < last.size(); ++i) {
    if (!last.has_stereo(i)) continue;
    const Keypoint& seen = last.keypoint(i);
    const Eigen::Vector3d p_w = T_w_last * camera_.back_project(seen.x, seen.y, last.depth(i));
    const Eigen::Vector3d p_c = expected.T_c_w * p_w;
    if (p_c.z() <= 0) continue;
    const Eigen::Vector3d pixel = camera_.project_stereo(p_c);
    if (!camera_.in_image(pixel.x(), pixel.y())) continue;
    SearchQuery query = query_for_feature(last, i, pixel, scales_);
    query.radius = radius * scales_.scale[seen.octave];
    query.min_octave = 0;
    query.max_octave = scales_.levels() - 1;
    query.prior = &priors.emplace_back(with_belief(last.prior(i)));
    queries.push_back(query);
    points.push_back(p_w);
    landmarks.push_back(last_->landmarks[i]);
  }
  SearchOptions options;
  options.max_distance = options_.max_distance;
  options.check_rotation = true;
  const std::vector<SearchMatch> matches =
      search_features(*frame.features, scales_, queries, options, *model_, result.statistics);

  std::vector<PoseObservation> observations;
  std::vector<Vote> votes;
  std::vector<std::pair<std::size_t, LandmarkId>> matched;  // feature, its landmark if it has one
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    const auto i = static_cast<std::size_t>(matches[q].feature);
    const kys::Prior& prior = frame.features->prior(i);
    observations.push_back(observation(frame, i, points[q], 1));
    observations.back().share = std::min(belief(*queries[q].prior), belief(prior));
    if (options_.consensus.by_class) votes.push_back(vote(prior, *queries[q].prior));
    matched.emplace_back(i, landmarks[q]);
  }
  const ConsensusResult consensus =
      estimate_pose(camera_, expected.T_c_w, observations, votes, expected, options_.consensus);
  result.reason += "; points of the last frame";
  frame.T_c_w = consensus.pose.T_c_w;
  if (consensus.pose.inliers < options_.min_pose_inliers || !is_expected(frame)) {
    result.reason += ": " + std::to_string(consensus.pose.inliers) + " inliers";
    return false;
  }
  std::fill(frame.landmarks.begin(), frame.landmarks.end(), LandmarkId{});
  for (std::size_t k = 0; k < matched.size(); ++k) {
    if (consensus.pose.outlier[k] == 0) frame.landmarks[matched[k].first] = matched[k].second;
  }
  result.overruled = consensus.overruled;
  result.jumped = false;
  return true;
}

}  // namespace kys_slam
