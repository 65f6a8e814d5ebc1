// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/pose_estimation.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {

const char* to_string(PoseSource source) {
  switch (source) {
    case PoseSource::kMotion:
      return "motion model";
    case PoseSource::kReference:
      return "reference keyframe";
    case PoseSource::kMap:
      return "local map";
    case PoseSource::kPoints:
      return "points of the last frame";
    case PoseSource::kRelocalisation:
      return "relocalised";
  }
  return "";
}

/// A landmark is no exact point: one that a single keyframe has seen adds half the variance of a
/// keypoint, n keyframes the n-th part of that. Where landmarks count as exact, the 95 % bound
/// rejects good matches with new ones (docs/differences.md, noise of landmarks).
StereoPixel pixel_of(const TrackingContext& context, const FrameFeatures& features,
                     std::size_t feature, std::size_t observers) {
  StereoPixel pixel = features.stereo_pixel(feature, context.scales);
  const double count = std::max<double>(1, static_cast<double>(observers));
  const double noise = context.options.landmark_noise / count;
  pixel.inv_sigma /= static_cast<float>(std::sqrt(1 + noise));
  return pixel;
}

PoseObservation observation_of(const TrackingContext& context, const FrameFeatures& features,
                               std::size_t feature, const Eigen::Vector3d& p_w,
                               std::size_t observers) {
  const StereoPixel pixel = pixel_of(context, features, feature, observers);
  return {p_w, pixel.u, pixel.v, pixel.u_right, pixel.inv_sigma, 1, pixel.ratio};
}

int assign_matches(std::span<const SearchMatch> matches, std::span<const LandmarkId> wanted,
                   std::vector<LandmarkId>& landmarks) {
  int count = 0;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    landmarks[static_cast<std::size_t>(matches[q].feature)] = wanted[q];
    ++count;
  }
  return count;
}

namespace {

/// The matches of a candidate as the pose estimation takes them.
struct Terms {
  std::vector<PoseObservation> observations;
  std::vector<Vote> votes;
  std::vector<std::size_t> features;
};

Terms terms_of(const TrackingContext& context, const FrameFeatures& features,
               const std::vector<LandmarkId>& landmarks) {
  Terms terms;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (!landmarks[i].valid()) continue;
    const LandmarkView& landmark = context.replica.landmarks().at(landmarks[i]);
    const kys::Prior& prior = features.prior(i);
    terms.observations.push_back(
        observation_of(context, features, i, landmark.p_w, landmark.observers.size()));
    terms.observations.back().share =
        std::min(context.beliefs.weight(landmark.prior), context.beliefs.weight(prior));
    if (context.options.consensus.by_class) {
      terms.votes.push_back(context.beliefs.vote(prior, landmark.prior));
    }
    terms.features.push_back(i);
  }
  return terms;
}

/// Whether the observations say so little that the expected pose has to hold the frame: the
/// position is more uncertain than a share of the uncertainty of the expected position. Not where
/// most observations are outliers far from there: after a sudden reversal the camera is elsewhere,
/// which the judge finds out.
bool needs_hold(const TrackingContext& context, const PosePrior& prior, double reach,
                const PoseResult& pose, std::size_t observations) {
  const double away = centre_distance(pose.T_c_w, prior.T_c_w);
  const bool elsewhere =
      pose.inliers < context.options.judge.min_inlier_share * static_cast<double>(observations) &&
      away > context.options.consensus.max_acceleration * reach;
  return !elsewhere &&
         position_sigma(pose) > context.options.max_relative_sigma * prior.sigma_position;
}

}  // namespace

void estimate(const TrackingContext& context, const FrameFeatures& features, double taken,
              PoseCandidate& candidate, bool expects) {
  candidate.held.reset();
  const Terms terms = terms_of(context, features, candidate.landmarks);
  const std::optional<ExpectedPose> expected =
      expects ? context.motion.expected(taken) : std::nullopt;
  const Start start = candidate.overruled ? Start::kConsensus : Start::kGuess;
  const auto pose_from = [&](const Rigid3& T_c_w, const PoseOptions& pose) {
    return estimate_pose(context.camera, T_c_w, terms.observations, terms.votes, expected,
                         context.options.consensus, start, pose);
  };
  ConsensusResult found = pose_from(candidate.T_c_w, {});
  if (const auto prior = expects ? context.motion.prior(taken) : std::nullopt) {
    if (needs_hold(context, *prior, expected->reach, found.pose, terms.observations.size())) {
      PoseOptions held;
      held.prior = prior;
      found = pose_from(prior->T_c_w, held);
      candidate.held = prior;
    }
  }
  candidate.T_c_w = found.pose.T_c_w;
  candidate.overruled |= found.overruled;
  candidate.matched = candidate.landmarks;
  for (std::size_t k = 0; k < terms.features.size(); ++k) {
    if (found.pose.outlier[k] != 0) candidate.landmarks[terms.features[k]] = {};
  }
  candidate.evidence.matches = static_cast<int>(terms.observations.size());
  candidate.evidence.inliers = found.pose.inliers;
  candidate.evidence.position_sigma = position_sigma(found.pose);
}

}  // namespace kys_slam
