// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/frame_source.h>

#include <span>
#include <vector>

namespace kys_slam {

/// Source of the priors of keypoints (paper, Sec. 3.4). Called once per frame, in order.
class PriorProvider {
 public:
  PriorProvider() = default;
  PriorProvider(const PriorProvider&) = delete;
  PriorProvider& operator=(const PriorProvider&) = delete;
  virtual ~PriorProvider() = default;

  /// Fills one prior per keypoint of each image. Returns false when the frame has no priors.
  /// \throws InputError when the priors of the frame are unusable.
  virtual bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                       std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                       std::vector<kys::Prior>& right_priors) = 0;

  /// The segments of the left image of the frame read last, with or without keypoints; nothing
  /// if they are not known. Valid until the next look_up().
  [[nodiscard]] virtual std::span<const kys::Prior> segments() const { return {}; }
};

}  // namespace kys_slam
