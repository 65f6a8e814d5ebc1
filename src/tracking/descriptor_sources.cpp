// SPDX-License-Identifier: BSD-3-Clause
#include <kys/prior.h>

#include <deque>
#include <span>

#include "matching/descriptor_matcher.h"
#include "tracking/pose_estimation.h"
#include "tracking/pose_sources.h"

namespace kys_slam {
namespace {

/// Landmarks to be found without a prediction.
struct Wanted {
  PoseSource source = PoseSource::kReference;
  std::vector<DescriptorQuery> queries;
  std::vector<LandmarkId> landmarks;  // per query
  bool angles = false;                // the queries have orientations of one image
  bool expects = true;                // the camera to go on as it did
};

Attempt find_by_descriptor(const TrackingContext& c, const TrackedFrame& frame,
                           const Wanted& wanted) {
  Attempt attempt;
  PoseCandidate& candidate = attempt.candidate;
  candidate.source = wanted.source;
  candidate.T_c_w = c.last->T_c_w;
  candidate.landmarks.resize(frame.landmarks.size());
  const DescriptorMatchOptions options{c.options.reference_distance, c.options.reference_ratio,
                                       wanted.angles};
  const std::vector<std::int32_t> matches =
      match_descriptors(wanted.queries, *frame.features, options, c.model, attempt.statistics);
  int count = 0;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q] < 0) continue;
    candidate.landmarks[static_cast<std::size_t>(matches[q])] = wanted.landmarks[q];
    ++count;
  }
  candidate.evidence.matches = count;
  if (count < c.options.min_reference_matches) {
    attempt.failure = std::to_string(count) + " matches";
    return attempt;
  }
  estimate(c, *frame.features, frame.taken, candidate, wanted.expects);
  candidate.evidence.matches = count;
  if (candidate.evidence.inliers < c.options.min_pose_inliers) {
    attempt.failure = std::to_string(candidate.evidence.inliers) + " inliers";
  }
  return attempt;
}

}  // namespace

Attempt ReferenceSource::find(const TrackingContext& c, const TrackedFrame& frame) const {
  const KeyFrameView& reference = c.replica.keyframes().at(c.reference);
  Wanted wanted;
  wanted.angles = true;
  wanted.expects = every == 1;
  // Class and instance are those of the keyframe's feature, like its descriptor; motion is that of
  // the latest observation.
  std::vector<kys::Prior> priors(reference.landmarks.size());
  std::size_t known = 0;
  for (std::size_t i = 0; i < reference.landmarks.size(); ++i) {
    const LandmarkView* landmark = c.replica.landmarks().find(reference.landmarks[i]);
    if (landmark == nullptr || known++ % every != 0) continue;
    priors[i] =
        c.beliefs.with_belief(kys::landmark_prior(reference.features->prior(i), landmark->prior));
    wanted.queries.push_back(
        {&reference.features->descriptor(i), &priors[i], reference.features->keypoint(i).angle});
    wanted.landmarks.push_back(reference.landmarks[i]);
  }
  return find_by_descriptor(c, frame, wanted);
}

Attempt MapSource::find(const TrackingContext& c, const TrackedFrame& frame) const {
  Wanted wanted;
  wanted.source = PoseSource::kMap;
  wanted.landmarks = c.gatherer.gather(c.replica, c.last->landmarks).landmarks;
  std::deque<kys::Prior> priors;
  for (const LandmarkId id : wanted.landmarks) {
    const LandmarkView& landmark = c.replica.landmarks().at(id);
    wanted.queries.push_back({&landmark.descriptor, c.beliefs.of_landmark(landmark, priors)});
  }
  return find_by_descriptor(c, frame, wanted);
}

}  // namespace kys_slam
