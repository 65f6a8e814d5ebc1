// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <vector>

#include "map/map.h"

namespace kys_slam {

struct LandmarkCullingOptions {
  double min_found_ratio = 0.25;  ///< share of the frames with the landmark in view that match it
  /// required after two keyframes; a stereo observation counts twice
  int min_observation_weight = 4;
};
/// For check_options().
void describe(kys::OptionList& list, LandmarkCullingOptions& options);

/// Landmarks created by the last keyframes, which are culled by stricter rules (ORB-SLAM, Sec.
/// VI-B).
class RecentLandmarks {
 public:
  void add(LandmarkId id) { recent_.push_back(id); }
  /// Erases landmarks that are rarely matched, or that have too few observations after two
  /// keyframes. After three keyframes a landmark is no longer tested. Returns the number erased.
  int cull(Map& map, KeyFrameId current, const LandmarkCullingOptions& options);

 private:
  std::vector<LandmarkId> recent_;
};

struct KeyFrameCullingOptions {
  double redundant_share = 0.9;  ///< share of its close landmarks that other keyframes observe
  int min_observers = 3;  ///< other keyframes that observe a landmark at the same or a finer scale
  double close_baselines = 40;  ///< baselines; farther landmarks do not count
};
/// For check_options().
void describe(kys::OptionList& list, KeyFrameCullingOptions& options);

/// Culls covisible keyframes of `current` when a share above `redundant_share` of their close
/// landmarks is observed by at least `min_observers` others at the same or a finer scale (ORB-SLAM,
/// Sec. VI-E). Returns the number culled.
int cull_keyframes(Map& map, KeyFrameId current, const KeyFrameCullingOptions& options);

}  // namespace kys_slam
