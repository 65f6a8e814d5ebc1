// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

namespace kys_slam {

struct KeyFramePolicyOptions {
  int min_frames = 0;   ///< least gap of keyframes while enough is tracked
  int max_frames = 30;  ///< frames after which a busy mapper does not delay a keyframe
  /// share of the reference's landmarks below which a keyframe is made
  double reference_ratio = 0.85;
  double starved_ratio = 0.25;  ///< share below which one is made also when the mapper is busy
  int tracked_close = 100;      ///< close stereo points tracked: with fewer a keyframe is needed
  int untracked_close = 70;     ///< if more than this many close points can be added
  /// close points that can be added, per tracked one, above which a keyframe is needed; 0: off
  double untracked_ratio = 3;
  int min_inliers = 15;  ///< with fewer, no keyframe is made
  /// landmarks in a frame below which addable points call for a keyframe; 0: off
  int min_tracked = 100;
  bool every_frame = false;  ///< every tracked frame becomes one: accurate, twice the mapping
  int max_waiting = 4;       ///< keyframes the back end may still have in hand; below the delay of
                             ///< the pipelined schedule, a map with few landmarks would get none
};
/// For check_options().
void describe(kys::OptionList& list, KeyFramePolicyOptions& options);

/// Input of the keyframe decision.
struct KeyFrameSituation {
  int frames_since_keyframe = 0;
  int keyframes_in_map = 0;
  int inliers = 0;              ///< landmarks matched in this frame
  int reference_landmarks = 0;  ///< well-observed landmarks of the reference keyframe
  int tracked_close = 0;        ///< close stereo points of this frame with a landmark
  int untracked_close = 0;      ///< close stereo points without one
  /// stereo points without a landmark, close or far; counted below `min_tracked` landmarks
  int addable = 0;
  int waiting = 0;  ///< keyframes sent to the back end and not yet finished
};

/// Whether a frame becomes a keyframe: the rules of ORB-SLAM2 for stereo with the close-point rule
/// (Sec. III-G). Depends on counts, not on time.
bool needs_keyframe(const KeyFrameSituation& situation, const KeyFramePolicyOptions& options);

}  // namespace kys_slam
