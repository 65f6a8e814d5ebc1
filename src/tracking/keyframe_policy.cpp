#include "tracking/keyframe_policy.h"

namespace kys_slam {

bool wants_keyframe(const KeyFrameSituation& s, const KeyFramePolicyOptions& o) {
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
