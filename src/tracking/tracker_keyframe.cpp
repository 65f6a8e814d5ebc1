// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

// Whether a frame becomes a keyframe, and what it gives to the map.

#include <algorithm>
#include <utility>

namespace kys_slam {

KeyFrameSituation Tracker::situation(const Frame& frame, int inliers, int waiting) const {
  KeyFrameSituation s;
  s.frames_since_keyframe = static_cast<int>(frame.index - last_keyframe_frame_);
  // In a loaded map that nothing was added to there is no last keyframe yet.
  s.keyframes_in_map = last_keyframe_.valid() ? 1 + static_cast<int>(last_keyframe_.value) -
                                                    static_cast<int>(first_keyframe_.value)
                                              : static_cast<int>(replica_.keyframes().size());
  s.inliers = inliers;
  s.waiting = waiting;
  if (inliers < options_.keyframes.scarce) s.addable = count_addable(frame);
  const std::size_t min_observers = s.keyframes_in_map <= 2 ? 2 : 3;
  const std::vector<LandmarkId>& expected = replica_.keyframes().at(reference_).landmarks;
  replica_.landmarks().visit(expected, [&](LandmarkId, const LandmarkView& landmark) {
    // A stereo observation counts twice, and most are: one observer less is enough.
    if (2 * landmark.observers.size() >= min_observers) ++s.reference_landmarks;
  });
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const float depth = frame.features->depth(i);
    if (depth <= 0 || depth > close_depth_ || !is_believed_static(frame.features->prior(i)))
      continue;
    ++(frame.landmarks[i].valid() ? s.tracked_close : s.untracked_close);
  }
  return s;
}

/// Stereo points that a keyframe would add as landmarks were it to add all.
int Tracker::count_addable(const Frame& frame) const {
  int count = 0;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (frame.landmarks[i].valid() || !frame.features->has_stereo(i)) continue;
    count += is_believed_static(frame.features->prior(i)) ? 1 : 0;
  }
  return count;
}

/// Since the last keyframe, of a frame that is held by its expected pose.
std::optional<ExpectedMotion> Tracker::expected_motion(const Frame& frame) const {
  if (!frame.held) return std::nullopt;
  const KeyFrameView* last = replica_.keyframes().find(last_keyframe_);
  if (last == nullptr || last->submap != submap(reference_)) return std::nullopt;
  const auto steps = static_cast<double>(frame.index - last_keyframe_frame_);
  return ExpectedMotion{last_keyframe_, frame.held->T_c_w * last->T_c_w.inverse(), replica_.scale(),
                        steps * frame.held->sigma_position, steps * frame.held->sigma_rotation};
}

KeyFrameMessage Tracker::make_keyframe(Frame& frame) {
  KeyFrameMessage message;
  frame.features = with_beliefs(std::move(frame.features));
  if (instances_) message.beliefs = instances_->take_changed_beliefs();
  if (frame.left != nullptr) {
    frame.features = patches_.with_origins(frame.landmarks, *frame.features);
  }
  message.id = {next_keyframe_++};
  message.frame_index = frame.index;
  message.timestamp = frame.timestamp;
  message.T_c_w = frame.T_c_w;
  message.features = frame.features;
  message.tracked = frame.landmarks;
  message.reference = reference_;
  if (reference_.valid()) {
    message.T_c_reference = frame.T_c_w * replica_.keyframes().at(reference_).T_c_w.inverse();
    message.scale = replica_.scale();
  }
  message.motion = expected_motion(frame);
  add_stereo_landmarks(frame, message);
  for (const NewLandmark& landmark : message.new_landmarks) {
    frame.landmarks[landmark.feature] = landmark.id;
  }
  message.counts = counts_.take();
  message.late_priors = std::exchange(late_, {});

  // The replica has it at once; the back end's view of it follows in a change set.
  KeyFrameView view;
  view.submap = reference_.valid() ? submap(reference_) : message.id;
  view.T_c_w = frame.T_c_w;
  view.features = frame.features;
  view.landmarks = frame.landmarks;
  if (reference_.valid()) view.neighbours.push_back(reference_);
  view.parent = reference_;
  replica_.put_pending(message.id, std::move(view));
  for (const LandmarkId id : message.tracked) replica_.add_observer(id, message.id);
  if (frame.left != nullptr) {
    patches_.keep(message.id, frame.landmarks, *frame.left, *frame.features);
  }
  reference_ = last_keyframe_ = message.id;
  last_keyframe_frame_ = frame.index;
  return message;
}

/// Every close stereo point without a landmark becomes one; where close ones are few, the nearest
/// hundred.
void Tracker::add_stereo_landmarks(const Frame& frame, KeyFrameMessage& message) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < frame.features->size(); ++i) {
    if (frame.features->has_stereo(i) && is_believed_static(frame.features->prior(i)))
      order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return frame.features->depth(a) < frame.features->depth(b);
  });
  // The first keyframe gives the map all it has: nothing else is there to track. Where little is
  // tracked the next ones do so as well.
  const bool all = !message.reference.valid() || frame.landmark_count() < options_.keyframes.scarce;
  constexpr std::size_t kNearest = 100;
  const Rigid3 T_w_c = frame.T_c_w.inverse();
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t i = order[k];
    const float depth = frame.features->depth(i);
    if (!all && depth > close_depth_ && k >= kNearest) break;
    if (frame.landmarks[i].valid()) continue;
    const Keypoint& keypoint = frame.features->keypoint(i);
    const Eigen::Vector3d p_w = T_w_c * camera_.back_project(keypoint.x, keypoint.y, depth);
    const LandmarkId id = landmark_ids_.next();
    message.new_landmarks.push_back({id, static_cast<std::uint32_t>(i), p_w});
    replica_.put(id, first_view(frame, i, p_w, message.id));
  }
  std::sort(message.new_landmarks.begin(), message.new_landmarks.end(),
            [](const NewLandmark& a, const NewLandmark& b) { return a.feature < b.feature; });
}

LandmarkView Tracker::first_view(const Frame& frame, std::size_t feature,
                                 const Eigen::Vector3d& p_w, KeyFrameId keyframe) const {
  const Eigen::Vector3d ray = p_w - frame.T_c_w.inverse_t();
  LandmarkView view;
  view.p_w = p_w;
  view.normal = ray.normalized().cast<float>();
  const ScaleLevels::DistanceRange range =
      scales_.distance_range(ray.norm(), frame.features->keypoint(feature).octave);
  view.min_distance = range.min;
  view.max_distance = range.max;
  view.descriptor = frame.features->descriptor(feature);
  view.prior = frame.features->prior(feature);
  view.observers = {keyframe};
  return view;
}

}  // namespace kys_slam
