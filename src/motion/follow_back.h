// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "map/frame_features.h"
#include "motion/instance_motion.h"

namespace kys_slam {

/// Keypoints of a frame and their matches in an earlier frame.
struct Followed {
  std::size_t frames = 0;  ///< number of frames back; 0: not tracked
  std::vector<std::pair<std::size_t, std::size_t>> keypoints;  ///< then, now
};

/// Tracks keypoints back from frame to frame. The span is the largest over which at least
/// `min_matches` keypoints, and at least `kept_share` of those matched in the frame before, can be
/// tracked.
/// \param now frame with `back`: per keypoint its match in the frame before; -1: none
/// \param frames earlier frames, latest first, each with `back`; at least one
template <typename Frame, typename Frames>
Followed follow_back(std::span<const std::size_t> keypoints, const Frame& now, const Frames& frames,
                     int min_matches, double kept_share) {
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> spans(frames.size());
  for (const std::size_t i : keypoints) {
    std::int32_t at = now.back[i];
    for (std::size_t s = 0; s < frames.size() && at >= 0; ++s) {
      spans[s].emplace_back(static_cast<std::size_t>(at), i);
      at = frames[s].back[static_cast<std::size_t>(at)];
    }
  }
  const double enough =
      std::max(static_cast<double>(min_matches), kept_share * static_cast<double>(spans[0].size()));
  std::size_t span = frames.size();
  while (span > 0 && static_cast<double>(spans[span - 1].size()) < enough) --span;
  if (span == 0) return {};
  return {span, std::move(spans[span - 1])};
}

inline std::vector<InstanceMatch> matches_of(const Followed& followed, const FrameFeatures& before,
                                             const FrameFeatures& now, const ScaleLevels& scales) {
  std::vector<InstanceMatch> matches;
  for (const auto& [then, i] : followed.keypoints) {
    matches.push_back({before.stereo_pixel(then, scales), now.stereo_pixel(i, scales)});
  }
  return matches;
}

}  // namespace kys_slam
