// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/evaluation.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {
namespace {

std::size_t nearest(std::span<const TimedPose> poses, double timestamp) {
  const auto after =
      std::lower_bound(poses.begin(), poses.end(), timestamp,
                       [](const TimedPose& pose, double time) { return pose.timestamp < time; });
  if (after == poses.begin()) return 0;
  const auto i = static_cast<std::size_t>(after - poses.begin());
  if (after == poses.end()) return i - 1;
  return timestamp - poses[i - 1].timestamp <= after->timestamp - timestamp ? i - 1 : i;
}

}  // namespace

TrajectoryPair associate_by_time(std::span<const TimedPose> reference,
                                 std::span<const TimedPose> estimate, double max_difference) {
  const bool reference_is_longer = reference.size() >= estimate.size();
  const auto& longer = reference_is_longer ? reference : estimate;
  const auto& shorter = reference_is_longer ? estimate : reference;
  TrajectoryPair pair;
  if (longer.empty() || shorter.empty()) return pair;
  auto& from_longer = reference_is_longer ? pair.reference : pair.estimate;
  auto& from_shorter = reference_is_longer ? pair.estimate : pair.reference;
  for (const TimedPose& pose : shorter) {
    const TimedPose& partner = longer[nearest(longer, pose.timestamp)];
    if (std::abs(partner.timestamp - pose.timestamp) > max_difference) continue;
    from_longer.push_back(partner);
    from_shorter.push_back(pose);
  }
  return pair;
}

}  // namespace kys_slam
