#pragma once

#include <kys/distance.h>
#include <kys_slam/frame_source.h>

#include <span>
#include <vector>

namespace kys_slam {

/// Where the priors of keypoints come from. Called once per frame, in order.
class PriorProvider {
 public:
  PriorProvider() = default;
  PriorProvider(const PriorProvider&) = delete;
  PriorProvider& operator=(const PriorProvider&) = delete;
  virtual ~PriorProvider() = default;

  /// Fills one prior per keypoint of either image; false: there are none for this frame.
  /// \throws InputError when there are some and they are unusable.
  virtual bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                       std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                       std::vector<kys::Prior>& right_priors) = 0;
};

}  // namespace kys_slam
