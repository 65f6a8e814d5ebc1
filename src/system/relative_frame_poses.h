// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "map/map.h"
#include "tracking/tracker.h"

namespace kys_slam {

/// The pose of every frame relative to the keyframe before it and to the keyframe after it. When
/// optimisation moves the keyframes, a frame between two of them follows both, weighted by their
/// distance in frames. With one of them alone the trajectory would have a step at the other.
class RelativeFramePoses {
 public:
  /// Adds the next frame; an invalid reference: no pose.
  void add(const FramePose& before) { frames_.push_back({before, {}, 0}); }
  /// Takes back the last `count` frames, which had no pose.
  void take_back(std::size_t count) { frames_.resize(frames_.size() - count); }
  /// The last frame added became keyframe `id`: stores the poses of the frames since the last
  /// keyframe relative to it.
  void close(KeyFrameId id, const Tracker& tracker);
  [[nodiscard]] std::size_t size() const { return frames_.size(); }
  /// Sub-map of a frame; invalid for one without a pose.
  [[nodiscard]] KeyFrameId submap(const Map& map, std::size_t frame) const {
    const KeyFrameId reference = frames_.at(frame).before.reference;
    return reference.valid() ? map.submap(reference) : KeyFrameId{};
  }
  /// Its pose relative to the keyframe before it.
  [[nodiscard]] const FramePose& before(std::size_t frame) const {
    return frames_.at(frame).before;
  }
  /// T_w_c of a frame in the present map; nothing for a frame without a pose.
  [[nodiscard]] std::optional<Rigid3> pose(const Map& map, std::size_t frame) const;

 private:
  struct Entry {
    FramePose before;
    FramePose after;
    double share = 0;  // of the frames from the keyframe before to the one after
  };
  std::vector<Entry> frames_;
  std::size_t last_keyframe_ = 0;  // frame
};

}  // namespace kys_slam
