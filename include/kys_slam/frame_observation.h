#pragma once

#include <kys/distance.h>
#include <kys_slam/features.h>
#include <kys_slam/report.h>

#include <cstdint>
#include <functional>
#include <span>

namespace kys_slam {

/// A thing of the priors in one frame; known in mode `verified`, which judges what moves.
struct ObservedInstance {
  std::int32_t instance = -1;
  std::uint16_t label = 0xFFFF;  ///< dense index in the label space
  double p_moving = 0;           ///< 0..1
  int keypoints = 0;             ///< stereo keypoints on it
};

/// What the system saw in one frame. The lists but `instances` are one entry per keypoint of the
/// left image, index by index. All are valid during the call only.
struct FrameObservation {
  const FrameReport* report = nullptr;
  std::span<const Keypoint> keypoints;
  std::span<const float> depths;            ///< m along the optical axis; negative: no stereo match
  std::span<const kys::Prior> priors;       ///< empty: no priors for this frame
  std::span<const std::int64_t> landmarks;  ///< id of the landmark seen, -1: none
  /// How each keypoint compares with its landmark; kSkipped: none.
  std::span<const kys::Tier> tiers;
  std::span<const ObservedInstance> instances;
};

/// Called once per frame by the thread that feeds, after the frame is tracked. It may ask the
/// system for its map or trajectory.
using FrameObserver = std::function<void(const FrameObservation&)>;

}  // namespace kys_slam
