// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

#include <kys_slam/check_options.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <utility>

#include "tracking/local_map_pose.h"
#include "tracking/pose_estimation.h"

namespace kys_slam {
namespace {

void take_pose(const PoseCandidate& candidate, TrackedFrame& frame) {
  frame.T_c_w = candidate.T_c_w;
  frame.landmarks = candidate.landmarks;
  frame.held = candidate.held;
}

}  // namespace

Tracker::Tracker(const StereoCamera& camera, const ScaleLevels& scales,
                 const TrackerOptions& options, const kys::DistanceModel& model,
                 const kys::InitialBelief& start)
    : camera_(camera),
      scales_(scales),
      options_(options),
      model_(&model),
      patches_(camera, scales),
      covariance_(camera, scales),
      motion_(options.motion),
      instances_(camera, scales, options, model, start) {
  check_options(options);
}

TrackingContext Tracker::context() {
  return {camera_,
          scales_,
          options_,
          *model_,
          replica_,
          motion_,
          instances_.beliefs(),
          local_map_gatherer_,
          last_ ? &*last_ : nullptr,
          reference_};
}

void Tracker::apply(ChangeSet changes) {
  patches_.apply(changes);
  map_moved_ |= changes.moved;
  covariance_.set_rig(changes.rig_sigma);
  replica_.apply(std::move(changes));
}

TrackedFrame Tracker::make_frame(const TrackerInput& input, TrackResult& result) {
  TrackedFrame frame;
  frame.index = input.index;
  frame.timestamp = input.timestamp;
  frame.taken = result.taken = motion_.time_of(input.index, input.timestamp, input.repeated);
  frame.features = input.features;
  if (instances_.in_use()) {
    const Rigid3 T_last_w = last_ ? last_->T_c_w : Rigid3{};
    const std::optional<ExpectedPose> expected = motion_.expected(frame.taken);
    frame.features = instances_.assign_priors(frame.taken, *frame.features,
                                              expected ? expected->T_c_w : T_last_w, T_last_w);
  }
  if (options_.align && input.left != nullptr) {
    frame.features = std::make_shared<const FrameFeatures>(frame.features->with_image_noise());
    frame.left = input.left;
  }
  frame.segments = input.segments;
  frame.landmarks.resize(frame.features->size());
  return frame;
}

TrackResult Tracker::track(const TrackerInput& input, int waiting) {
  TrackResult result;
  Stopwatch watch;
  if (last_) refresh_last_frame();
  TrackedFrame frame = make_frame(input, result);
  if (!last_) {
    if (replica_.keyframes().empty()) {
      start_map(frame, result);
    } else {
      result.reason = "not yet found in the map";
      result.refused = true;
    }
    return result;
  }
  Prediction prediction = judge_.predict(context(), frame);
  result.reason = std::move(prediction.trail);
  result.jumped = prediction.jumped;
  result.statistics += prediction.statistics;
  result.times.predict = watch.lap_ms();
  bool tracked = prediction.candidate && use_local_map(frame, *prediction.candidate, result);
  result.times.local_map = watch.lap_ms();
  if (tracked) {
    finish_tracked(std::move(frame), std::move(*prediction.candidate), waiting, result);
  } else {
    instances_.forget_frames();
    result.refused |= result.jumped;
  }
  return result;
}

/// Improves a first pose. False when the result does not stand.
bool Tracker::use_local_map(TrackedFrame& frame, PoseCandidate& candidate, TrackResult& result) {
  LocalMapPose refined = refine_with_local_map(context(), frame, std::move(candidate), patches_);
  if (refined.reference.valid()) reference_ = refined.reference;
  keyframes_.count(refined.visible, refined.found);
  frame.features = std::move(refined.features);
  candidate = std::move(refined.candidate);
  result.statistics += refined.statistics;
  result.matches = candidate.evidence.matches;
  result.inliers = candidate.evidence.inliers;
  const Objection objection = judge_.objection(context(), frame, candidate);
  if (objection.why.empty()) return true;
  result.refused = objection.refused;
  result.reason += "; " + objection.why;
  return false;
}

/// A frame with a pose: perhaps a keyframe, and what the next one starts from. False where the pose
/// rests on objects that turn out to move.
bool Tracker::finish_tracked(TrackedFrame frame, PoseCandidate candidate, int waiting,
                             TrackResult& result) {
  Stopwatch watch;
  if (candidate.overruled) result.reason += "; image area against most matches";
  if (candidate.held) result.reason += "; held by constant velocity";
  result.held = candidate.held.has_value();
  result.overruled = candidate.overruled;
  take_pose(candidate, frame);
  if (instances_.in_use()) {
    result.instances = instances_.judge(context(), frame, result.statistics);
    drop_moving(frame, candidate);
    result.inliers = candidate.evidence.inliers;
  }
  if (result.inliers < std::min(options_.min_predicted_inliers, options_.min_local_inliers)) {
    result.reason += "; " + std::to_string(result.inliers) + " inliers stand still";
    result.refused = true;
    result.instances.clear();
    instances_.forget_frames();
    return false;
  }
  result.status = TrackingStatus::kTracked;
  const bool follows = last_ && last_->index + 1 == frame.index && !result.relocalised;
  result.integrity = integrity_.check(context(), frame, candidate.evidence, result.jumped, follows,
                                      result.statistics);
  const KeyFrameId last_keyframe = last_ ? keyframes_.keyframe_of(last_->index) : KeyFrameId{};
  result.uncertainty =
      uncertainty_of(context(), frame, !result.relocalised, last_keyframe, covariance_);
  if (keyframes_.is_due(context(), frame, result.inliers, waiting)) {
    result.keyframe = make_keyframe(frame);
  }
  result.times.keyframe = watch.lap_ms();
  keep_as_last(std::move(frame), result);
  return true;
}

/// Landmarks on what turns out to move are dropped; the pose is that of the others.
void Tracker::drop_moving(TrackedFrame& frame, PoseCandidate& candidate) {
  const Beliefs beliefs = instances_.beliefs();
  bool changed = false;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (!frame.landmarks[i].valid() || beliefs.is_static(frame.features->prior(i))) continue;
    candidate.landmarks[i] = {};
    changed = true;
  }
  if (!changed) return;
  estimate(context(), *frame.features, frame.taken, candidate);
  take_pose(candidate, frame);
}

KeyFrameMessage Tracker::make_keyframe(TrackedFrame& frame) {
  frame.features = instances_.with_beliefs(std::move(frame.features));
  std::vector<InstanceBelief> beliefs = instances_.take_changed();
  KeyFrameMessage message = keyframes_.make(context(), frame, replica_, patches_);
  message.beliefs = std::move(beliefs);
  message.late_priors = take_late_priors();
  reference_ = message.id;
  return message;
}

/// What the next frame starts from.
void Tracker::keep_as_last(TrackedFrame frame, TrackResult& result) {
  const KeyFrameId anchor = replica_.resolve(reference_).keyframe;
  frame.pose = {anchor, frame.T_c_w * replica_.keyframes().at(anchor).T_c_w.inverse(),
                replica_.scale()};
  result.pose = frame.pose;
  result.T_c_w = frame.T_c_w;
  using Link = MotionModel::Link;
  motion_.add(frame.index, frame.taken, frame.T_c_w,
              result.relocalised                          ? Link::kRelocalised
              : result.status == TrackingStatus::kStarted ? Link::kStarted
                                                          : Link::kTracked);
  instances_.keep(frame.pose, last_ && last_->taken == frame.taken);
  last_ = std::move(frame);
  last_->left = nullptr;  // the next frame's image comes into its place
  last_->segments = {};
}

/// The map may have moved since the last frame: its pose follows its keyframe, its landmarks their
/// successors.
void Tracker::refresh_last_frame() {
  const Rigid3 T_c_w_before = last_->T_c_w;
  last_->pose = anchored(replica_, last_->pose);
  last_->T_c_w = current_pose(last_->pose);
  motion_.move_last(last_->T_c_w);
  for (LandmarkId& id : last_->landmarks) {
    if (id.valid()) id = replica_.resolve(id);
  }
  reference_ = replica_.resolve(reference_).keyframe;
  if (std::exchange(map_moved_, false)) {
    instances_.turn_world(last_->T_c_w.rotation.conjugate() * T_c_w_before.rotation);
  }
}

}  // namespace kys_slam
