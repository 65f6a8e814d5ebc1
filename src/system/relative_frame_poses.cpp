// SPDX-License-Identifier: BSD-3-Clause
#include "system/relative_frame_poses.h"

namespace kys_slam {

void RelativeFramePoses::close(KeyFrameId id, const Tracker& tracker) {
  const std::size_t at = frames_.size() - 1;
  const Rigid3 T_w_k = tracker.current_pose(frames_[at].before).inverse();
  for (std::size_t f = last_keyframe_ + 1; f < at; ++f) {
    Entry& entry = frames_[f];
    if (!entry.before.reference.valid()) continue;
    if (tracker.submap(entry.before.reference) != tracker.submap(id)) continue;
    entry.after = {id, tracker.current_pose(entry.before) * T_w_k, tracker.replica().scale()};
    entry.share =
        static_cast<double>(f - last_keyframe_) / static_cast<double>(at - last_keyframe_);
  }
  last_keyframe_ = at;
}

std::optional<Rigid3> RelativeFramePoses::pose(const Map& map, std::size_t frame) const {
  const Entry& entry = frames_.at(frame);
  const auto from = [&](const FramePose& pose) -> std::optional<Rigid3> {
    const std::optional<Rigid3> T_k_w = map.pose(pose.reference);
    if (!T_k_w) return std::nullopt;
    return (pose.at_scale(map.scale()) * *T_k_w).inverse();
  };
  std::optional<Rigid3> before = from(entry.before);
  const std::optional<Rigid3> after = from(entry.after);
  if (!before || !after) return before;
  return Rigid3(before->rotation.slerp(entry.share, after->rotation),
                (1 - entry.share) * before->translation + entry.share * after->translation);
}

}  // namespace kys_slam
