// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/pose_judge.h"

#include <utility>

#include "tracking/pose_estimation.h"
#include "tracking/pose_sources.h"
#include "tracking/scene_support.h"

namespace kys_slam {

void describe(kys::OptionList& list, JudgeOptions& o) {
  list.add("tracking.min_inlier_share", o.min_inlier_share, {0, 1}, "",
           "share of inliers below which a pose far from the expected one is doubted");
  list.add("tracking.inlier_drop", o.inlier_drop, {0, 1}, "",
           "share of inliers, as a part of that of the last frame, below which a pose is doubted");
  list.add("tracking.explained_share", o.explained_share, {0, 1}, "",
           "share of inliers with which another pose replaces a doubted one");
  list.add("tracking.sample_stride", o.sample_stride, {1, 1000}, "",
           "every n-th landmark of the reference keyframe is searched first to test a doubt");
  list.add("tracking.co_moving_share", o.co_moving_share, {0, 1}, "",
           "share of the other matches that fit a slower camera, from which an object that moves "
           "along explains them");
  list.add("tracking.co_moving_step", o.co_moving_step, {0, 1}, "",
           "part of the way that this slower camera goes at most");
  list.add("tracking.expected_share", o.expected_share, {0, 1}, "",
           "share of inliers from which a pose near the expected one may have few inliers");
  describe(list, o.support);
}

namespace {

void add_to_trail(std::string& trail, const std::string& text) {
  trail += (trail.empty() ? "" : "; ") + text;
}

/// What a source found, and how far it came when it found nothing.
void note_attempt(const Attempt& attempt, Prediction& prediction) {
  add_to_trail(prediction.trail, to_string(attempt.candidate.source));
  if (!attempt.found()) prediction.trail += ": " + attempt.failure;
  prediction.statistics += attempt.statistics;
}

}  // namespace

Prediction PoseJudge::predict(const TrackingContext& c, const TrackedFrame& frame) {
  Prediction prediction;
  if (!c.motion.expected(frame.taken)) {
    find_unexpected(c, frame, false, prediction);
    return prediction;
  }
  Attempt near = MotionSource{}.find(c, frame);
  note_attempt(near, prediction);
  const double before = share_;
  if (near.candidate.evidence.matches > 0) share_ = near.candidate.evidence.inlier_share();
  if (!near.found()) {
    find_unexpected(c, frame, true, prediction);
    return prediction;
  }
  const Doubt doubt = doubt_about(c, frame, near.candidate, before);
  prediction.candidate = std::move(near.candidate);
  prediction.jumped = doubt.impossible;
  if (doubt.impossible && replace_by_map(c, frame, 0, prediction)) return prediction;
  if (doubt.fallen) compare_with_reference(c, frame, doubt, prediction);
  if (doubt.impossible) prediction.trail += "; impossible motion";
  return prediction;
}

/// When the camera turns back or stops suddenly, matches near the expected pose fit by chance, and
/// their share of inliers falls from one frame to the next. The share also falls when an object
/// covers much of the view: then the lost matches agree in a motion of their own, a camera that
/// hardly moves, and the pose is right. An impossible acceleration is evidence by itself, so that a
/// lower share is enough.
PoseJudge::Doubt PoseJudge::doubt_about(const TrackingContext& c, const TrackedFrame& frame,
                                        const PoseCandidate& candidate, double share_before) const {
  const JudgeOptions& o = c.options.judge;
  Doubt doubt;
  doubt.impossible = c.motion.is_impossible(candidate.T_c_w, frame.taken);
  doubt.fallen = doubt.impossible ? share_ < o.min_inlier_share
                                  : share_ < o.inlier_drop * share_before &&
                                        !others_move_along(c, frame, candidate);
  return doubt;
}

/// Whether most of the matches that the candidate has lost are on something that moves along with
/// the camera: a camera that hardly moves fits them.
bool PoseJudge::others_move_along(const TrackingContext& c, const TrackedFrame& frame,
                                  const PoseCandidate& candidate) const {
  std::vector<PoseObservation> others;
  for (std::size_t i = 0; i < candidate.matched.size(); ++i) {
    if (!candidate.matched[i].valid() || candidate.landmarks[i].valid()) continue;
    const LandmarkView& landmark = c.replica.landmarks().at(candidate.matched[i]);
    others.push_back(
        observation_of(c, *frame.features, i, landmark.p_w, landmark.observers.size()));
  }
  const Rigid3& last = c.last->T_c_w;
  const PoseResult pose = optimize_pose(c.camera, last, others);
  return pose.inliers >= c.options.judge.co_moving_share * static_cast<double>(others.size()) &&
         centre_distance(pose.T_c_w, last) <
             c.options.judge.co_moving_step * centre_distance(candidate.T_c_w, last);
}

/// Nothing is expected, or nothing was found there.
void PoseJudge::find_unexpected(const TrackingContext& c, const TrackedFrame& frame, bool expected,
                                Prediction& prediction) const {
  Attempt attempt = ReferenceSource{}.find(c, frame);
  note_attempt(attempt, prediction);
  if (attempt.found()) {
    if (is_possible(c, frame, attempt.candidate.T_c_w)) {
      prediction.candidate = std::move(attempt.candidate);
      return;
    }
    prediction.jumped = true;
    prediction.trail += "; impossible motion";
  }
  if (!expected || c.options.motion.acceleration <= 0) return;
  attempt = PointSource{}.find(c, frame);
  note_attempt(attempt, prediction);
  if (!attempt.found()) return;
  prediction.candidate = std::move(attempt.candidate);
  prediction.jumped = false;
}

/// After a sudden reversal the camera is far from the expected pose, and the matches found there
/// fit by chance. A search without an expectation then fits nearly all of the keyframe, or leads to
/// a pose that is far away as well.
void PoseJudge::compare_with_reference(const TrackingContext& c, const TrackedFrame& frame,
                                       const Doubt& doubt, Prediction& prediction) {
  const JudgeOptions& o = c.options.judge;
  Attempt other;
  const auto share_of = [&](int every) {
    other = ReferenceSource{static_cast<std::size_t>(every)}.find(c, frame);
    prediction.statistics += std::exchange(other.statistics, {});
    return other.found() ? other.candidate.evidence.inlier_share() : 0.0;
  };
  const auto is_elsewhere = [&] {
    return c.motion.is_impossible(other.candidate.T_c_w, frame.taken);
  };
  if (!doubt.impossible) {
    const double sampled = share_of(o.sample_stride);
    const bool explains =
        sampled >= o.explained_share || (sampled >= o.min_inlier_share && is_elsewhere());
    if (!explains) return;
  }
  const double share = share_of(1);
  const int inliers = prediction.candidate->evidence.inliers;
  if (share >= o.explained_share && other.candidate.evidence.inliers > inliers) {
    replace(std::move(other), "doubtful motion model", prediction);
  } else if (!doubt.impossible && share >= o.min_inlier_share && is_elsewhere()) {
    replace_by_map(c, frame, o.min_inlier_share, prediction);
  }
}

/// For a pose that needs an impossible acceleration: it may follow an object that moves along with
/// the camera, which a search near the expected pose prefers. The whole local map is searched
/// without an expectation. Its pose is used when it fits at least `least_share` of the matches.
bool PoseJudge::replace_by_map(const TrackingContext& c, const TrackedFrame& frame,
                               double least_share, Prediction& prediction) {
  Attempt other = MapSource{}.find(c, frame);
  prediction.statistics += std::exchange(other.statistics, {});
  const Evidence& evidence = other.candidate.evidence;
  if (!other.found() || evidence.inliers < c.options.min_local_inliers ||
      evidence.inliers < least_share * evidence.matches) {
    return false;
  }
  replace(std::move(other), "impossible motion", prediction);
  prediction.jumped = true;
  return true;
}

void PoseJudge::replace(Attempt attempt, const char* doubted, Prediction& prediction) {
  share_ = attempt.candidate.evidence.inlier_share();
  prediction.trail = doubted;
  note_attempt(attempt, prediction);
  prediction.candidate = std::move(attempt.candidate);
}

bool PoseJudge::is_possible(const TrackingContext& c, const TrackedFrame& frame,
                            const Rigid3& T_c_w) const {
  return c.options.motion.acceleration <= 0 || !c.motion.is_impossible(T_c_w, frame.taken, 1);
}

/// ORB-SLAM calls a frame lost below 30 inliers. Near the expected pose half of them are enough:
/// wrong matches agree in one pose by chance, but not in the expected one. `expected_share` is
/// several times the share of wrong matches that do so.
Objection PoseJudge::objection(const TrackingContext& c, const TrackedFrame& frame,
                               const PoseCandidate& candidate) {
  const Evidence& evidence = candidate.evidence;
  const bool sure =
      c.motion.is_near(candidate.T_c_w, frame.taken, c.options.consensus.max_acceleration) &&
      evidence.inliers >= c.options.judge.expected_share * evidence.matches;
  const int wanted = sure ? c.options.min_predicted_inliers : c.options.min_local_inliers;
  if (evidence.inliers < wanted) {
    return {"local map: " + std::to_string(evidence.inliers) + " inliers"};
  }
  if (is_supported(c, frame, candidate)) return {};
  return {"local map: only objects that can move support the pose", true};
}

/// With beliefs: whether what cannot move supports the pose, or did so a short time ago, or is not
/// in view. Otherwise objects that move together may carry the pose along. Parked ones may hold it
/// for a short time, while new parts of the scene come into view.
bool PoseJudge::is_supported(const TrackingContext& c, const TrackedFrame& frame,
                             const PoseCandidate& candidate) {
  if (!c.beliefs.in_use()) return true;
  const SceneSupportOptions& o = c.options.judge.support;
  const SceneSupport support = scene_support(c, *frame.features, candidate.landmarks);
  if (!support.is_in_view(o)) {
    if (supported_) supported_ = frame.taken;
    return true;
  }
  if (support.is_enough(o)) supported_ = frame.taken;
  return supported_ && frame.taken - *supported_ <= o.longest;
}

}  // namespace kys_slam
