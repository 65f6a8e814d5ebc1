// SPDX-License-Identifier: BSD-3-Clause
// Where there is no pose to go on from: a map, a sub-map, a place that was recognised.
#include <kys_slam/util/stopwatch.h>

#include <string>
#include <utility>

#include "tracking/pose_estimation.h"
#include "tracking/tracker.h"

namespace kys_slam {

TrackResult Tracker::resume(const TrackerInput& input, const KnownPlace& place, int waiting) {
  TrackResult result;
  result.reason = to_string(PoseSource::kRelocalisation);
  result.relocalised = true;
  Stopwatch watch;
  // The back end was waited for: it may have moved the map since track().
  if (last_) refresh_last_frame();
  TrackedFrame frame = make_frame(input, result);
  PoseCandidate candidate;
  candidate.source = PoseSource::kRelocalisation;
  candidate.T_c_w = place.T_c_w;
  if (submap(place.reference) == submap(reference_) &&
      !judge_.is_possible(context(), frame, place.T_c_w)) {
    result.jumped = true;
    result.refused = true;
    result.reason += "; impossible motion";
    return result;
  }
  candidate.landmarks.resize(frame.landmarks.size());
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (replica_.landmarks().contains(place.landmarks[i])) {
      candidate.landmarks[i] = place.landmarks[i];
    }
  }
  // Where it was before may be another sub-map, with another world.
  const MotionModel motion = motion_;
  motion_.forget_velocity();
  estimate(context(), *frame.features, frame.taken, candidate);
  const KeyFrameId before = std::exchange(reference_, place.reference);
  const KeyFrameId first = keyframes_.first();
  bool tracked = use_local_map(frame, candidate, result);
  result.times.local_map = watch.lap_ms();
  if (tracked) {
    if (submap(reference_) != submap(before)) {
      keyframes_.set_first(reference_);
      instances_.forget_velocities();
    }
    tracked = finish_tracked(std::move(frame), std::move(candidate), waiting, result);
  }
  if (!tracked) {
    reference_ = before;
    keyframes_.set_first(first);
    motion_ = motion;
  }
  return result;
}

bool Tracker::can_start(const FrameFeatures& features) const {
  if (instances_.misses_priors()) return false;
  return !keyframes_.frozen() && features.stereo_count() >= options_.min_start_points;
}

TrackResult Tracker::start_submap(const TrackerInput& input) {
  TrackResult result;
  TrackedFrame frame = make_frame(input, result);
  const KeyFrameId before = std::exchange(reference_, KeyFrameId{});
  start_map(frame, result);
  if (result.status != TrackingStatus::kStarted) reference_ = before;
  return result;
}

/// A frame with enough stereo points becomes the first keyframe of a map, at the world's origin.
void Tracker::start_map(TrackedFrame& frame, TrackResult& result) {
  const int stereo = frame.features->stereo_count();
  if (stereo < options_.min_start_points) {
    result.reason = "too few stereo points to start a map: " + std::to_string(stereo);
    return;
  }
  result.status = TrackingStatus::kStarted;
  result.reason = "start";
  judge_.start_map();
  if (instances_.in_use()) {
    instances_.forget_velocities();
    result.instances = instances_.judge(context(), frame, result.statistics);
  }
  result.keyframe = make_keyframe(frame);
  keyframes_.set_first(result.keyframe->id);
  result.inliers = result.matches = static_cast<int>(result.keyframe->new_landmarks.size());
  keep_as_last(std::move(frame), result);
}

}  // namespace kys_slam
