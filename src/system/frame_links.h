#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "map/map.h"
#include "tracking/tracker.h"

namespace kys_slam {

/// Where every frame hangs in the map: from the keyframe before it and from the one after it. When
/// optimisation moves or stretches the map, a frame between two keyframes follows both, each by how
/// near it is; a frame tied to one alone would leave the other's side torn.
class FrameLinks {
 public:
  /// The next frame; an invalid reference: it has no pose.
  void add(const FramePose& before) { links_.push_back({before, {}, 0}); }
  /// The last frame added became keyframe `id`: ties the frames since the keyframe before to it.
  void close(KeyFrameId id, const Tracker& tracker);
  [[nodiscard]] std::size_t size() const { return links_.size(); }
  /// Sub-map of a frame; invalid for one without a pose.
  [[nodiscard]] KeyFrameId submap(const Map& map, std::size_t frame) const {
    const KeyFrameId reference = links_.at(frame).before.reference;
    return reference.valid() ? map.submap(reference) : KeyFrameId{};
  }
  /// How a frame hangs from the keyframe before it.
  [[nodiscard]] const FramePose& before(std::size_t frame) const { return links_.at(frame).before; }
  /// T_w_c of a frame in the map as it is now; nothing for a frame without a pose.
  [[nodiscard]] std::optional<Rigid3> pose(const Map& map, std::size_t frame) const;

 private:
  struct Link {
    FramePose before;
    FramePose after;
    double share = 0;  // of the way from the keyframe before to the one after
  };
  std::vector<Link> links_;
  std::size_t last_keyframe_ = 0;  // frame
};

}  // namespace kys_slam
