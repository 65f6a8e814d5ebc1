// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/keyframe_maker.h"

#include <algorithm>

#include "tracking/pose_estimation.h"
#include "tracking/replica_poses.h"

namespace kys_slam {
namespace {

/// Points nearer than this are close: stereo alone gives an accurate position, m.
float close_depth(const TrackingContext& c) {
  return static_cast<float>(c.options.close_baselines * c.camera.baseline);
}

/// Stereo points that a keyframe would add as landmarks were it to add all.
int count_addable(const TrackingContext& c, const TrackedFrame& frame) {
  int count = 0;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (frame.landmarks[i].valid() || !frame.features->has_stereo(i)) continue;
    count += c.beliefs.is_static(frame.features->prior(i)) ? 1 : 0;
  }
  return count;
}

LandmarkView first_view(const TrackingContext& c, const TrackedFrame& frame, std::size_t feature,
                        const Eigen::Vector3d& p_w, KeyFrameId keyframe) {
  const Eigen::Vector3d ray = p_w - frame.T_c_w.inverse_t();
  LandmarkView view;
  view.p_w = p_w;
  view.normal = ray.normalized().cast<float>();
  const ScaleLevels::DistanceRange range =
      c.scales.distance_range(ray.norm(), frame.features->keypoint(feature).octave);
  view.min_distance = range.min;
  view.max_distance = range.max;
  view.descriptor = frame.features->descriptor(feature);
  view.prior = frame.features->prior(feature);
  view.observers = {keyframe};
  return view;
}

}  // namespace

void KeyFrameMaker::continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end,
                                 bool frozen) {
  next_ = keyframe_id_end;
  landmark_ids_.continue_after(landmark_id_end);
  frozen_ = frozen;
}

void KeyFrameMaker::count(const std::vector<LandmarkId>& visible,
                          const std::vector<LandmarkId>& found) {
  for (const LandmarkId id : visible) counts_.add_visible(id);
  for (const LandmarkId id : found) counts_.add_found(id);
}

bool KeyFrameMaker::is_due(const TrackingContext& c, const TrackedFrame& frame, int inliers,
                           int waiting) const {
  return !frozen_ && needs_keyframe(situation(c, frame, inliers, waiting), c.options.keyframes);
}

KeyFrameSituation KeyFrameMaker::situation(const TrackingContext& c, const TrackedFrame& frame,
                                           int inliers, int waiting) const {
  KeyFrameSituation s;
  s.frames_since_keyframe = static_cast<int>(frame.index - last_frame_);
  // In a loaded map that nothing was added to there is no last keyframe yet.
  s.keyframes_in_map = last_.valid()
                           ? 1 + static_cast<int>(last_.value) - static_cast<int>(first_.value)
                           : static_cast<int>(c.replica.keyframes().size());
  s.inliers = inliers;
  s.waiting = waiting;
  if (inliers < c.options.keyframes.min_tracked) s.addable = count_addable(c, frame);
  const std::size_t min_observers = s.keyframes_in_map <= 2 ? 2 : 3;
  const std::vector<LandmarkId>& expected = c.replica.keyframes().at(c.reference).landmarks;
  c.replica.landmarks().visit(expected, [&](LandmarkId, const LandmarkView& landmark) {
    // A stereo observation counts twice, and most are: one observer less is enough.
    if (2 * landmark.observers.size() >= min_observers) ++s.reference_landmarks;
  });
  const float close = close_depth(c);
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const float depth = frame.features->depth(i);
    if (depth <= 0 || depth > close || !c.beliefs.is_static(frame.features->prior(i))) continue;
    ++(frame.landmarks[i].valid() ? s.tracked_close : s.untracked_close);
  }
  return s;
}

/// Since the last keyframe, of a frame that is held by its expected pose.
std::optional<ExpectedMotion> KeyFrameMaker::expected_motion(const TrackingContext& c,
                                                             const TrackedFrame& frame) const {
  if (!frame.held) return std::nullopt;
  const KeyFrameView* last = c.replica.keyframes().find(last_);
  if (last == nullptr || last->submap != submap_of(c.replica, c.reference)) return std::nullopt;
  const auto steps = static_cast<double>(frame.index - last_frame_);
  return ExpectedMotion{last_, frame.held->T_c_w * last->T_c_w.inverse(), c.replica.scale(),
                        steps * frame.held->sigma_position, steps * frame.held->sigma_rotation};
}

KeyFrameMessage KeyFrameMaker::make(const TrackingContext& c, TrackedFrame& frame, Replica& replica,
                                    LandmarkPatches& patches) {
  KeyFrameMessage message;
  if (frame.left != nullptr) {
    frame.features = patches.with_origins(frame.landmarks, *frame.features);
  }
  message.id = {next_++};
  message.frame_index = frame.index;
  message.timestamp = frame.timestamp;
  message.T_c_w = frame.T_c_w;
  message.features = frame.features;
  message.tracked = frame.landmarks;
  message.reference = c.reference;
  if (c.reference.valid()) {
    message.T_c_reference = frame.T_c_w * replica.keyframes().at(c.reference).T_c_w.inverse();
    message.scale = replica.scale();
  }
  message.motion = expected_motion(c, frame);
  add_stereo_landmarks(c, frame, replica, message);
  for (const NewLandmark& landmark : message.new_landmarks) {
    frame.landmarks[landmark.feature] = landmark.id;
  }
  message.counts = counts_.take();

  // The replica has it at once; the back end's view of it follows in a change set.
  KeyFrameView view;
  view.submap = c.reference.valid() ? submap_of(replica, c.reference) : message.id;
  view.T_c_w = frame.T_c_w;
  view.features = frame.features;
  view.landmarks = frame.landmarks;
  if (c.reference.valid()) view.neighbours.push_back(c.reference);
  view.parent = c.reference;
  replica.put_pending(message.id, std::move(view));
  for (const LandmarkId id : message.tracked) replica.add_observer(id, message.id);
  if (frame.left != nullptr) {
    patches.keep(message.id, frame.landmarks, *frame.left, *frame.features);
  }
  last_ = message.id;
  last_frame_ = frame.index;
  return message;
}

/// Every close stereo point without a landmark becomes one; where close ones are few, the nearest
/// hundred.
void KeyFrameMaker::add_stereo_landmarks(const TrackingContext& c, const TrackedFrame& frame,
                                         Replica& replica, KeyFrameMessage& message) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < frame.features->size(); ++i) {
    if (frame.features->has_stereo(i) && c.beliefs.is_static(frame.features->prior(i))) {
      order.push_back(i);
    }
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return frame.features->depth(a) < frame.features->depth(b);
  });
  // The first keyframe gives the map all it has: nothing else is there to track. Where little is
  // tracked the next ones do so as well.
  const bool all =
      !message.reference.valid() || frame.landmark_count() < c.options.keyframes.min_tracked;
  constexpr std::size_t kNearest = 100;
  const float close = close_depth(c);
  const Rigid3 T_w_c = frame.T_c_w.inverse();
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t i = order[k];
    const float depth = frame.features->depth(i);
    if (!all && depth > close && k >= kNearest) break;
    if (frame.landmarks[i].valid()) continue;
    const Keypoint& keypoint = frame.features->keypoint(i);
    const Eigen::Vector3d p_w = T_w_c * c.camera.back_project(keypoint.x, keypoint.y, depth);
    const LandmarkId id = landmark_ids_.next();
    message.new_landmarks.push_back({id, static_cast<std::uint32_t>(i), p_w});
    replica.put(id, first_view(c, frame, i, p_w, message.id));
  }
  std::sort(message.new_landmarks.begin(), message.new_landmarks.end(),
            [](const NewLandmark& a, const NewLandmark& b) { return a.feature < b.feature; });
}

}  // namespace kys_slam
