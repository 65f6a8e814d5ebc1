#pragma once

#include <kys/option_list.h>

namespace kys_slam {

struct KeyFramePolicyOptions {
  int min_frames = 0;             ///< frames between two keyframes at least
  int max_frames = 30;            ///< frames after which a keyframe is wanted anyway
  double reference_ratio = 0.75;  ///< share of the reference's landmarks below which one is due
  double starved_ratio = 0.25;    ///< share below which one is made though the mapper is busy
  int tracked_close = 100;        ///< close stereo points that should be tracked
  int untracked_close = 70;       ///< close stereo points that could be added
  int min_inliers = 15;           ///< below this the pose is too poor for a keyframe
  int scarce = 100;               ///< landmarks in a frame below which every new one counts; 0: off
  int max_waiting = 4;  ///< keyframes the back end may still have in hand; below the delay of
                        ///< the pipelined schedule, a map with few landmarks would get none
};
/// For check_options().
void describe(kys::OptionList& list, KeyFramePolicyOptions& options);

/// What the decision rests on.
struct KeyFrameSituation {
  int frames_since_keyframe = 0;
  int keyframes_in_map = 0;
  int inliers = 0;              ///< landmarks matched in this frame
  int reference_landmarks = 0;  ///< well-observed landmarks of the reference keyframe
  int tracked_close = 0;        ///< close stereo points of this frame with a landmark
  int untracked_close = 0;      ///< close stereo points without one
  int addable = 0;              ///< stereo points without a landmark, near or far; counted where
                                ///< little is tracked
  int waiting = 0;              ///< keyframes sent to the back end and not yet answered
};

/// Whether a frame becomes a keyframe: ORB-SLAM2's rules for stereo, with the close-point rule
/// (Sec. III-G). A function of counts, never of the clock.
bool wants_keyframe(const KeyFrameSituation& situation, const KeyFramePolicyOptions& options);

}  // namespace kys_slam
