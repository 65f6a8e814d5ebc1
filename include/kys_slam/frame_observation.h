// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/features.h>
#include <kys_slam/report.h>

#include <cstdint>
#include <functional>
#include <span>

namespace kys_slam {

/// An instance of the priors in one frame. In mode `verified` only.
struct ObservedInstance {
  std::int32_t instance = -1;
  std::uint16_t label = 0xFFFF;  ///< dense index in the label space
  double p_moving = 0;           ///< 0..1
  int keypoints = 0;             ///< number of stereo keypoints on it
};

/// What the system observes in one frame. All lists except `instances` have one entry per keypoint
/// of the left image, index by index. All spans are valid during the call only.
struct FrameObservation {
  const FrameReport* report = nullptr;
  std::span<const Keypoint> keypoints;
  std::span<const float> depths;            ///< m along the optical axis; negative: no stereo match
  std::span<const kys::Prior> priors;       ///< empty: no priors for this frame
  std::span<const std::int64_t> landmarks;  ///< id of the matched landmark, -1: none
  /// Tier of each keypoint's match with its landmark; kSkipped: no landmark.
  std::span<const kys::Tier> tiers;
  std::span<const ObservedInstance> instances;
};

/// Called once per frame after tracking, in the thread that calls `feed`. It may call the getters
/// of the system.
using FrameObserver = std::function<void(const FrameObservation&)>;

}  // namespace kys_slam
