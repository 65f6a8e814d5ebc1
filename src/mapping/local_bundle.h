#pragma once

#include <kys/option_list.h>

#include <atomic>
#include <cstddef>
#include <vector>

#include "map/map.h"
#include "optimization/bundle_adjustment.h"

namespace kys_slam {

struct LocalBundleOptions {
  std::size_t max_keyframes = 20;  ///< optimised, the current one included
  std::size_t max_fixed = 20;      ///< fixed ones that see the same landmarks, most shared first
  BundleOptions bundle;
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
};

/// One observation of a bundle problem as the map knows it.
struct ObservationRef {
  LandmarkId landmark;
  KeyFrameId keyframe;
  std::uint32_t feature = 0;
};

/// Adds landmarks and those of their observations that fall on `poses` (increasing ids, in the
/// order of the problem's poses) to a bundle problem. Returns one reference per observation.
std::vector<ObservationRef> add_landmarks(const Map& map, const std::vector<KeyFrameId>& poses,
                                          const std::vector<LandmarkId>& landmarks,
                                          BundleProblem& problem);

/// Bundle adjustment of a keyframe, its covisible ones and all landmarks they see; other keyframes
/// that see these landmarks stay fixed (ORB-SLAM, Sec. VI-D). Observations that do not fit are
/// taken out of the map.
LocalBundleReport adjust_locally(Map& map, KeyFrameId current, const LocalBundleOptions& options,
                                 const std::atomic<bool>* stop = nullptr);

}  // namespace kys_slam
