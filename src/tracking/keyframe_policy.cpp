#include "tracking/keyframe_policy.h"

namespace kys_slam {

void describe(kys::OptionList& list, KeyFramePolicyOptions& o) {
  list.add("keyframes.min_frames", o.min_frames, {0, 1e6}, "frames",
           "between two keyframes at least, while enough is tracked and the back end is idle");
  list.add("keyframes.max_frames", o.max_frames, {0, 1e9}, "frames",
           "after which a busy back end does not delay one");
  list.add("keyframes.reference_ratio", o.reference_ratio, {0, 1}, "",
           "share of the reference keyframe's landmarks below which one is due");
  list.add("keyframes.starved_ratio", o.starved_ratio, {0, 1}, "",
           "share below which one is made also when the back end is busy");
  list.add("keyframes.tracked_close", o.tracked_close, {0, 60000}, "",
           "tracked close points below which one is due ...");
  list.add("keyframes.untracked_close", o.untracked_close, {0, 60000}, "",
           "... when more than this many close points could be added");
  list.add("keyframes.min_inliers", o.min_inliers, {3, 60000}, "",
           "inliers below which none is made");
  list.add("keyframes.scarce", o.scarce, {0, 60000}, "",
           "landmarks in a frame below which addable points call for a keyframe; 0: off");
  list.add("keyframes.max_waiting", o.max_waiting, {0, 1000}, "",
           "keyframes queued in the back end above which none is made");
}

bool needs_keyframe(const KeyFrameSituation& s, const KeyFramePolicyOptions& o) {
  const bool close_points_short =
      s.tracked_close < o.tracked_close && s.untracked_close > o.untracked_close;
  // A map of one keyframe says little about how much of it should be in view.
  const double ratio = s.keyframes_in_map < 2 ? 0.4 : o.reference_ratio;

  const bool overdue = s.frames_since_keyframe >= o.max_frames;
  const bool mapper_idle = s.frames_since_keyframe >= o.min_frames && s.waiting == 0;
  const bool starved = s.inliers < o.starved_ratio * s.reference_landmarks || close_points_short;
  const bool moved_on = s.inliers < ratio * s.reference_landmarks || close_points_short;

  // Few landmarks, and half as many again could be had.
  const bool scarce = s.inliers < o.scarce && 2 * s.addable > s.inliers;
  return (((overdue || mapper_idle || starved) && moved_on) || scarce) &&
         s.inliers > o.min_inliers && s.waiting <= o.max_waiting;
}

}  // namespace kys_slam
