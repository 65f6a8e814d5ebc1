// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/keyframe_policy.h"

namespace kys_slam {

void describe(kys::OptionList& list, KeyFramePolicyOptions& o) {
  list.add(
      "keyframes.min_frames", o.min_frames, {0, 1e6}, "frames",
      "least number of frames between two keyframes while enough is tracked and the back end is "
      "idle");
  list.add(
      "keyframes.max_frames", o.max_frames, {0, 1e9}, "frames",
      "frames since the last keyframe after which a busy back end does not delay the next one");
  list.add("keyframes.reference_ratio", o.reference_ratio, {0, 1}, "",
           "share of the reference keyframe's landmarks below which a keyframe is needed");
  list.add(
      "keyframes.starved_ratio", o.starved_ratio, {0, 1}, "",
      "share of the reference keyframe's landmarks below which a keyframe is made also when the "
      "back end is busy");
  list.add("keyframes.tracked_close", o.tracked_close, {0, 60000}, "",
           "tracked close points below which a keyframe is needed, if more than "
           "keyframes.untracked_close can be added");
  list.add("keyframes.untracked_close", o.untracked_close, {0, 60000}, "",
           "close points that can be added, above which a keyframe is needed, if fewer than "
           "keyframes.tracked_close are tracked");
  list.add("keyframes.untracked_ratio", o.untracked_ratio, {0, 1000}, "",
           "close points that can be added, per tracked one, above which a keyframe is needed, if "
           "they are more than keyframes.untracked_close; 0: off");
  list.add("keyframes.min_inliers", o.min_inliers, {3, 60000}, "",
           "inliers of the pose below which no keyframe is made");
  list.add("keyframes.min_tracked", o.min_tracked, {0, 60000}, "",
           "landmarks in a frame below which a keyframe is made when it adds half as many; 0: off");
  list.add(
      "keyframes.every_frame", o.every_frame,
      "every tracked frame becomes a keyframe, unless too many wait or it has too few inliers");
  list.add("keyframes.max_waiting", o.max_waiting, {0, 1000}, "",
           "keyframes queued in the back end above which no keyframe is made");
}

/// A keyframe adds landmarks before those in view run out. ORB-SLAM2 asks two questions (Sec.
/// III-G): are fewer of the reference keyframe's landmarks tracked, and are near stereo points
/// short, which alone fix the translation. A second close-point rule compares what could be added
/// with what is tracked (`untracked_ratio`): a camera that turns into a new street still tracks 100
/// near points of the old one. `min_tracked` is for views that vehicles fill, where few landmarks
/// are left and each new one counts. Age alone makes no keyframe; counts, not times, decide, so
/// that a run is the same on every machine.
bool needs_keyframe(const KeyFrameSituation& s, const KeyFramePolicyOptions& o) {
  const bool few_tracked =
      s.tracked_close < o.tracked_close ||
      (o.untracked_ratio > 0 && s.untracked_close > o.untracked_ratio * s.tracked_close);
  const bool close_points_short = few_tracked && s.untracked_close > o.untracked_close;
  // A map of one keyframe says little about how much of it should be in view.
  const double ratio = s.keyframes_in_map < 2 ? 0.4 : o.reference_ratio;

  const bool overdue = s.frames_since_keyframe >= o.max_frames;
  const bool mapper_idle = s.frames_since_keyframe >= o.min_frames && s.waiting == 0;
  const bool starved = s.inliers < o.starved_ratio * s.reference_landmarks || close_points_short;
  const bool moved_on = s.inliers < ratio * s.reference_landmarks || close_points_short;

  // Few landmarks, and half as many can be added.
  const bool few_landmarks = s.inliers < o.min_tracked && 2 * s.addable > s.inliers;
  return (((overdue || mapper_idle || starved) && moved_on) || few_landmarks || o.every_frame) &&
         s.inliers > o.min_inliers && s.waiting <= o.max_waiting;
}

}  // namespace kys_slam
