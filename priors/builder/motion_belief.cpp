// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/motion_belief.h"

#include <kys_slam/prior_format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "motion/belief.h"

namespace kys_slam {
namespace {

// Limits of one frame's evidence by source, nats; and of what a camera and the keypoints say.
constexpr double kMaxFlow = 2.5, kMaxAppearance = 3, kMaxKeypoints = 3, kMaxCamera = 4,
                 kMaxFrame = 5;
// Few keypoints of a slow thing mostly fit standing still: that says less than that they do not.
constexpr double kMaxStillKeypoints = 1;
constexpr double kKeypointShare = 0.5;  // of a segment's that fit one motion: below, they are mixed
constexpr double kFlowSlope = 3;        // nats per e-fold of residual over threshold
constexpr double kParallaxError = 0.03;  // of the flow due to depth, added to the threshold
constexpr double kMinValid = 0.1;        // share of a segment's pixels with a residual
constexpr double kMinValidArea = 50;     // px, the same
constexpr double kScattered = 0.5;       // scatter over length: residuals that do not agree
constexpr double kScatteredFlow = 0.5;   // nats, at most then
constexpr int kFewPatches = 8, kManyPatches = 30;
constexpr double kAppearanceSlope = 8;  // nats per share of patches
constexpr double kStillShare = 0.4;     // of patches that look the same: says nothing
constexpr double kAlone = 0.3;          // nats, of appearance that nothing else supports
constexpr double kAlikeShift = 2.2,
                 kOtherShift = 3.7;     // px: shifts that patches cannot and can tell
constexpr double kMaxSpace = 2.5;       // nats
constexpr double kSpaceSlope = 8;       // nats per share of pixels whose place was free
constexpr double kFreeByError = 0.05;   // of pixels, where it stood still
constexpr double kLeastFree = 0.1;      // of all pixels looked at, hidden ones too
constexpr double kSupports = 0.5;       // nats, by which free space confirms a changed look
constexpr double kContradicted = -0.3;  // nats of appearance that void the flow's

}  // namespace

MotionEvidence motion_evidence(const BuilderOptions::Detection& options,
                               const SegmentStatistics& segment,
                               const BackgroundReferences& background) {
  MotionEvidence e;
  const MedianResidual& m = segment.median;
  const bool enough =
      segment.flow_count >= kMinValidArea && segment.flow_count >= kMinValid * segment.area;
  // Where there is no stuff around, only a residual far above every drift says something.
  const double alone = segment.coverage < options.min_coverage ? options.uncovered_factor : 1;
  if (enough && m.length > 0 && alone > 0) {
    const double threshold = options.robust_factor * background.m_bg *
                                 coverage_scale(options, segment.coverage) * alone +
                             kParallaxError * m.parallax;
    e.flow = std::clamp(kFlowSlope * std::log(m.length / threshold), -kMaxFlow, kMaxFlow);
    if (m.scatter > kScattered * m.length) e.flow = std::min(e.flow, kScatteredFlow);
  }
  const AppearanceEvidence& a = segment.appearance;
  if (a.patches >= kFewPatches) {
    const double share = std::min(1.0, static_cast<double>(a.patches) / kManyPatches);
    e.appearance = std::clamp(kAppearanceSlope * (kStillShare - a.still) * share, -kMaxAppearance,
                              kMaxAppearance);
  }
  const KeypointEvidence& k = segment.keypoints;
  if (k.matches > 0 && k.inliers >= kKeypointShare * k.matches) {
    e.keypoints = std::clamp(-k.log_ratio, -kMaxStillKeypoints, kMaxKeypoints);
  }
  if (e.appearance < 0 && e.flow > 0) {
    e.appearance *= std::clamp((m.length - kAlikeShift) / (kOtherShift - kAlikeShift), 0.0, 1.0);
    if (e.appearance < kContradicted) e.flow = 0;
  }
  const FreeSpaceEvidence& s = segment.space;
  if (s.free > 0 && s.free >= kLeastFree * (s.free + s.occupied + s.hidden)) {
    const double share = static_cast<double>(s.free) / (s.free + s.occupied);
    e.space = std::clamp(kSpaceSlope * (share - kFreeByError), 0.0, kMaxSpace);
  }
  if (e.appearance > 0 && e.flow <= 0 && e.space < kSupports) {
    e.appearance = std::min(e.appearance, kAlone);
  }
  return e;
}

std::int32_t MotionBelief::object_of(std::int32_t instance) const {
  return shares_instances_ ? instance % prior_format::kRightInstances : instance;
}

double MotionBelief::expected(std::int32_t object, double timestamp) const {
  const auto at = states_.find(object);
  if (at == states_.end()) return options_.start_log_odds;
  BeliefUpdateOptions update;
  update.max_log_odds = options_.max_log_odds;
  // The chain of the tracker is about standing still.
  return -after_time(-at->second.log_odds, -options_.start_log_odds,
                     timestamp - at->second.timestamp, update);
}

void MotionBelief::add(Frame frame) {
  for (auto& [object, of_frame] : frame.evidence) {
    of_frame.log_odds = std::clamp(expected(object, frame.timestamp) + of_frame.evidence,
                                   -options_.max_log_odds, options_.max_log_odds);
    states_[object] = {of_frame.log_odds, frame.timestamp};
  }
  frames_.push_back(std::move(frame));
}

void MotionBelief::restore_frame(double timestamp,
                                 const std::vector<std::pair<std::int32_t, double>>& evidence) {
  Frame frame{timestamp, {}};
  for (const auto& [instance, nats] : evidence) frame.evidence[object_of(instance)].evidence = nats;
  add(std::move(frame));
}

/// What the frames after the first say about an object, nats: the backward pass of the chain whose
/// forward pass is after_time().
double MotionBelief::later(std::int32_t object) const {
  const double steady = probability(options_.start_log_odds);
  // Likelihoods of what comes after, if it moves and if it stays still.
  double moves = 1, stays = 1, time = 0;
  bool any = false;
  const auto go_back = [&](double to) {
    const double share =
        1 - std::exp(-BeliefUpdateOptions{}.change_rate * std::max(time - to, 0.0));
    const double mean = steady * moves + (1 - steady) * stays;
    moves += share * (mean - moves);
    stays += share * (mean - stays);
    time = to;
  };
  for (std::size_t i = frames_.size() - 1; i > 0; --i) {
    const Frame& frame = frames_[i];
    const auto at = frame.evidence.find(object);
    if (at == frame.evidence.end()) continue;
    if (any) go_back(frame.timestamp);
    any = true;
    time = frame.timestamp;
    moves *= std::exp(at->second.evidence);
    const double sum = moves + stays;
    moves /= sum;
    stays /= sum;
  }
  if (!any) return 0;
  go_back(frames_.front().timestamp);
  return std::log(moves / stays);
}

void MotionBelief::add_frame(double timestamp, std::span<CameraFusion* const> cameras,
                             std::span<const std::vector<std::int32_t>* const> instances) {
  struct Sums {
    double cameras = 0, keypoints = 0;
    int count = 0;
    bool any = false;
  };
  std::map<std::int32_t, Sums> sums;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    CameraFusion& fusion = *cameras[c];
    for (std::size_t k = 0; k < fusion.segments.size(); ++k) {
      if (!fusion.segments[k].thing) continue;
      MotionDecision& decision = fusion.decisions[k];
      const MotionEvidence e = motion_evidence(options_, fusion.statistics[k], fusion.background);
      decision.evidence_flow = e.flow;
      decision.evidence_appearance = e.appearance;
      decision.evidence_keypoints = e.keypoints;
      decision.evidence_space = e.space;
      Sums& object = sums[object_of((*instances[c])[k])];
      object.cameras += std::clamp(e.flow + e.appearance + e.space, -kMaxCamera, kMaxCamera);
      // Both cameras see the same keypoints.
      if (std::abs(e.keypoints) > std::abs(object.keypoints)) object.keypoints = e.keypoints;
      ++object.count;
      object.any |= e.any();
    }
  }
  Frame frame{timestamp, {}};
  for (const auto& [object, sum] : sums) {
    const double evidence = sum.cameras / sum.count + sum.keypoints;
    frame.evidence[object] = {std::clamp(evidence, -kMaxFrame, kMaxFrame), 0, sum.any};
  }
  add(std::move(frame));
}

void MotionBelief::decide(std::span<CameraFusion* const> cameras,
                          std::span<const std::vector<std::int32_t>* const> instances) {
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    CameraFusion& fusion = *cameras[c];
    for (std::size_t k = 0; k < fusion.segments.size(); ++k) {
      if (!fusion.segments[k].thing) continue;
      MotionDecision& decision = fusion.decisions[k];
      const std::int32_t object = object_of((*instances[c])[k]);
      const FrameEvidence& of_frame = frames_.front().evidence.at(object);
      decision.evidence = of_frame.evidence;
      decision.log_odds = std::clamp(of_frame.log_odds + later(object), -options_.max_log_odds,
                                     options_.max_log_odds);
      decision.judged = of_frame.any;
      decision.dynamic = decision.log_odds > 0;
      decision.magnitude_test = decision.dynamic;
      decision.omega = coverage_scale(options_, fusion.statistics[k].coverage);
      decision.rho = fusion.background.m_bg > 0 ? residual_ratio(fusion.statistics[k].median.length,
                                                                 fusion.background.m_bg)
                                                : 0;
      decision.score = decision.dynamic ? 100 * probability(decision.log_odds) : 0;
    }
  }
  frames_.pop_front();
}

}  // namespace kys_slam
