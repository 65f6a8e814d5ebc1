#pragma once

#include <kys_slam/frame_source.h>

#include <span>
#include <vector>

namespace kys_slam {

/// Poses of a reference and of an estimate, one to one and in order of time.
struct TrajectoryPair {
  std::vector<TimedPose> reference;
  std::vector<TimedPose> estimate;

  [[nodiscard]] std::size_t size() const { return reference.size(); }
};

/// Pairs poses by time as evo does: every pose of the shorter trajectory takes the nearest of the
/// longer one when it is at most `max_difference` (s) away. Stamps must not decrease; published
/// trajectories do repeat some, and those count as often as they are there.
TrajectoryPair associate_by_time(std::span<const TimedPose> reference,
                                 std::span<const TimedPose> estimate, double max_difference = 0.01);

}  // namespace kys_slam
