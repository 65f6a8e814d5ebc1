// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <deque>

#include "matching/landmark_search.h"
#include "tracking/pose_estimation.h"
#include "tracking/pose_sources.h"

namespace kys_slam {
namespace {

/// The landmarks of the last frame where a camera at `T_c_w` sees them.
struct LastFrameQueries {
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> landmarks;  // per query
  std::deque<kys::Prior> priors;
};

LastFrameQueries queries_at(const TrackingContext& c, const Rigid3& T_c_w, float radius) {
  const TrackedFrame& last = *c.last;
  const Rigid3 T_c_last = T_c_w * last.T_c_w.inverse();
  const double forward = -(T_c_last.rotation.conjugate() * T_c_last.translation).z();
  const bool moving = std::abs(forward) > c.camera.baseline;
  LastFrameQueries result;
  for (std::size_t i = 0; i < last.landmarks.size(); ++i) {
    const LandmarkId id = last.landmarks[i];
    if (!id.valid()) continue;
    const LandmarkView& landmark = c.replica.landmarks().at(id);
    const Eigen::Vector3d p_c = T_c_w * landmark.p_w;
    if (p_c.z() <= 0) continue;
    const Eigen::Vector3d pixel = c.camera.project_stereo(p_c);
    if (!c.camera.in_image(pixel.x(), pixel.y())) continue;
    const Keypoint& seen = last.features->keypoint(i);
    SearchQuery query;
    query.u = static_cast<float>(pixel.x());
    query.v = static_cast<float>(pixel.y());
    query.u_right = static_cast<float>(pixel.z());
    query.radius = radius * c.scales.scale[seen.octave];
    // Objects appear larger when the camera approaches them.
    query.min_octave = moving && forward < 0 ? 0 : c.scales.lowest(seen.octave - (moving ? 0 : 1));
    query.max_octave = moving && forward > 0 ? c.scales.levels() - 1
                                             : c.scales.highest(seen.octave + (moving ? 0 : 1));
    query.angle = seen.angle;
    query.descriptor = &landmark.descriptor;
    query.prior = c.beliefs.of_landmark(landmark, result.priors);
    result.queries.push_back(query);
    result.landmarks.push_back(id);
  }
  return result;
}

/// Gives the frame's features the landmarks found near the expected pose; returns how many.
int match_last_frame(const TrackingContext& c, const TrackedFrame& frame, float radius,
                     Attempt& attempt) {
  const LastFrameQueries wanted = queries_at(c, attempt.candidate.T_c_w, radius);
  SearchOptions options;
  options.max_distance = c.options.max_distance;
  options.check_rotation = true;
  const std::vector<SearchMatch> matches = search_features(
      *frame.features, c.scales, wanted.queries, options, c.model, attempt.statistics);
  std::vector<LandmarkId>& landmarks = attempt.candidate.landmarks;
  landmarks.assign(frame.landmarks.size(), LandmarkId{});
  return assign_matches(matches, wanted.landmarks, landmarks);
}

}  // namespace

Attempt MotionSource::find(const TrackingContext& c, const TrackedFrame& frame) const {
  Attempt attempt;
  PoseCandidate& candidate = attempt.candidate;
  candidate.source = PoseSource::kMotion;
  candidate.T_c_w = c.motion.expected(frame.taken)->T_c_w;
  const float radius = c.options.motion_radius * c.motion.steps_since(frame.index, frame.taken);
  int matches = match_last_frame(c, frame, radius, attempt);
  if (matches < c.options.min_motion_matches) {
    matches = match_last_frame(c, frame, 2 * radius, attempt);
  }
  if (matches < c.options.min_motion_matches) {
    attempt.failure = std::to_string(matches) + " matches";
    return attempt;
  }
  estimate(c, *frame.features, frame.taken, candidate);
  if (candidate.evidence.inliers < c.options.min_pose_inliers) {
    attempt.failure = std::to_string(candidate.evidence.inliers) + " inliers";
  }
  return attempt;
}

}  // namespace kys_slam
