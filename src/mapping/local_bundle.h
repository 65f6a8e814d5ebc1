// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <atomic>
#include <cstddef>
#include <vector>

#include "map/map.h"
#include "optimization/bundle_adjustment.h"

namespace kys_slam {

struct LocalBundleOptions {
  std::size_t max_keyframes = 14;  ///< optimised, the current one included
  /// fixed keyframes that observe the same landmarks, most shared first
  std::size_t max_fixed = 20;
  /// A window is optimised again with the next keyframe: 1e-4 costs a tenth of all processor time
  /// more, for the same accuracy.
  BundleOptions bundle{.function_tolerance = 1e-3};
};
/// For check_options().
void describe(kys::OptionList& list, LocalBundleOptions& options);

struct LocalBundleReport {
  int keyframes = 0;
  int fixed = 0;
  int landmarks = 0;
  int observations = 0;
  int outliers = 0;
  int iterations = 0;
  std::vector<KeyFrameId> window;  ///< keyframes adjusted and held, by id
};

/// Reference of an observation of a bundle problem into the map.
struct ObservationRef {
  LandmarkId landmark;
  KeyFrameId keyframe;
  std::uint32_t feature = 0;
};

/// Adds landmarks and their observations by the keyframes `poses` (increasing ids, in the order of
/// the problem's poses) to a bundle problem. Returns one reference per observation.
std::vector<ObservationRef> add_landmarks(const Map& map, const std::vector<KeyFrameId>& poses,
                                          const std::vector<LandmarkId>& landmarks,
                                          BundleProblem& problem);

/// Adds the expected motions of these keyframes (increasing ids, in the order of the problem's
/// poses) where both ends are among them.
void add_motions(const Map& map, const std::vector<KeyFrameId>& poses, BundleProblem& problem);

/// Bundle adjustment of a keyframe, its covisible keyframes and all landmarks they observe. Other
/// keyframes that observe these landmarks are fixed (ORB-SLAM, Sec. VI-D). Outlier observations are
/// removed from the map.
LocalBundleReport adjust_locally(Map& map, KeyFrameId current, const LocalBundleOptions& options,
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace kys_slam
