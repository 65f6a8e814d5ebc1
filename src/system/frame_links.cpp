#include "system/frame_links.h"

namespace kys_slam {

void FrameLinks::close(KeyFrameId id, const Tracker& tracker) {
  const std::size_t at = links_.size() - 1;
  const Rigid3 T_w_k = tracker.current_pose(links_[at].before).inverse();
  for (std::size_t f = last_keyframe_ + 1; f < at; ++f) {
    Link& link = links_[f];
    if (!link.before.reference.valid()) continue;
    if (tracker.submap(link.before.reference) != tracker.submap(id)) continue;
    link.after = {id, tracker.current_pose(link.before) * T_w_k};
    link.share = static_cast<double>(f - last_keyframe_) / static_cast<double>(at - last_keyframe_);
  }
  last_keyframe_ = at;
}

std::optional<Rigid3> FrameLinks::pose(const Map& map, std::size_t frame) const {
  const Link& link = links_.at(frame);
  const auto from = [&](const FramePose& pose) -> std::optional<Rigid3> {
    const std::optional<Rigid3> T_k_w = map.pose(pose.reference);
    if (!T_k_w) return std::nullopt;
    return (pose.T_c_reference * *T_k_w).inverse();
  };
  std::optional<Rigid3> before = from(link.before);
  const std::optional<Rigid3> after = from(link.after);
  if (!before || !after) return before;
  return Rigid3(before->rotation.slerp(link.share, after->rotation),
                (1 - link.share) * before->translation + link.share * after->translation);
}

}  // namespace kys_slam
