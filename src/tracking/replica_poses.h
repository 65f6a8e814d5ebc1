// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "map/replica.h"
#include "tracking/tracked_frame.h"

namespace kys_slam {

/// A frame's pose relative to a keyframe that the replica has: its keyframe may be culled. The
/// culled keyframe's own frame lies between: T_c_ref_old * T_ref_old_ref_new.
inline FramePose anchored(const Replica& replica, const FramePose& pose) {
  const Replica::Anchor anchor = replica.resolve(pose.reference);
  return {anchor.keyframe, pose.at_scale(replica.scale()) * anchor.T_c_k, replica.scale()};
}

/// T_c_w of an earlier frame, from the present pose of its keyframe.
inline Rigid3 current_pose(const Replica& replica, const FramePose& pose) {
  const FramePose present = anchored(replica, pose);
  return present.T_c_reference * replica.keyframes().at(present.reference).T_c_w;
}

/// Sub-map of a keyframe; invalid: the replica does not have it.
inline KeyFrameId submap_of(const Replica& replica, KeyFrameId keyframe) {
  const KeyFrameView* view = replica.keyframes().find(replica.resolve(keyframe).keyframe);
  return view != nullptr ? view->submap : KeyFrameId{};
}

}  // namespace kys_slam
