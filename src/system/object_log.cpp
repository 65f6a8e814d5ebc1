// SPDX-License-Identifier: BSD-3-Clause
#include "system/object_log.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {

void describe(kys::OptionList& list, ObjectOptions& o) {
  list.add("objects.min_probability", o.min_probability, {0.001, 1}, "",
           "of moving, from which an instance is logged");
  list.add("objects.keep_probability", o.keep_probability, {0.001, 1}, "",
           "the same in the frames before and after those");
  list.add("objects.min_keypoints", o.min_keypoints, {0, 60000}, "",
           "stereo keypoints from which an instance is logged; a track is continued with fewer");
  describe(list, o.tracks);
}

namespace {

/// \param step s between two frames. Velocities over longer spans share keypoints with those of the
/// frames before: their covariance grows so that together they say no more than they know.
ObjectObservation observe(const InstanceState& state, double step, bool doubtful) {
  ObjectObservation seen;
  seen.instance = state.instance;
  seen.label = state.label;
  seen.p_moving = 1 - state.p_static;
  seen.keypoints = state.keypoints;
  seen.doubtful = doubtful;
  // What was measured of it while it seemed to stand still is not used.
  if (state.span <= 0 || doubtful) return seen;
  seen.place = {state.motion.centre, state.motion.centre_covariance};
  if (2 * state.motion.inliers <= state.matches) return seen;  // nothing that most agree on
  ObservedVelocity velocity;
  velocity.span = state.span;
  velocity.velocity_c = state.motion.motion.tail<3>() / state.span;
  const double shared = step > 0 ? std::max(1.0, state.span / step) : 1.0;
  velocity.covariance =
      state.motion.covariance.bottomRightCorner<3, 3>() * shared / (state.span * state.span);
  seen.velocity = velocity;
  return seen;
}

}  // namespace

void ObjectLog::add(double taken, std::span<const InstanceState> instances) {
  const double step = frames_.empty() ? 0.0 : taken - frames_.back().taken;
  ObjectFrame& frame = frames_.emplace_back();
  frame.taken = taken;
  for (const InstanceState& state : instances) {
    const double p_moving = 1 - state.p_static;
    const bool doubtful =
        p_moving < options_.min_probability || state.keypoints < options_.min_keypoints;
    const bool unlikely = doubtful && p_moving < options_.keep_probability;
    // What stands makes most of the instances: they are kept only where they can be in a track.
    if (!unlikely) {
      last_likely_[state.instance] = taken;
    } else if (const auto last = last_likely_.find(state.instance);
               last == last_likely_.end() || taken - last->second > options_.tracks.max_gap) {
      continue;
    }
    frame.observations.push_back(observe(state, step, doubtful));
    frame.observations.back().unlikely = unlikely;
  }
}

std::vector<ObjectEstimate> ObjectLog::objects(std::span<const FrameEstimate> trajectory) const {
  std::vector<ObjectFrame> frames = frames_;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (k < trajectory.size() && trajectory[k].connected) frames[k].T_w_c = trajectory[k].T_w_c;
  }
  return track_objects(frames, options_.tracks);
}

}  // namespace kys_slam
