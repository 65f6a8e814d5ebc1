#pragma once

#include <kys/option_list.h>

#include <vector>

#include "map/map.h"

namespace kys_slam {

struct LandmarkCullingOptions {
  double min_found_ratio = 0.25;   ///< frames in which it was matched of those that should see it
  int min_observation_weight = 4;  ///< after two keyframes; a stereo observation counts twice
};
/// For check_options().
void describe(kys::OptionList& list, LandmarkCullingOptions& options);

/// Landmarks made by the last few keyframes: they have to prove themselves (ORB-SLAM, Sec. VI-B).
class RecentLandmarks {
 public:
  void add(LandmarkId id) { recent_.push_back(id); }
  /// Erases those that are rarely found, or that two keyframes later too few keyframes see; three
  /// keyframes later a landmark has passed. Returns how many were erased.
  int cull(Map& map, KeyFrameId current, const LandmarkCullingOptions& options);

 private:
  std::vector<LandmarkId> recent_;
};

struct KeyFrameCullingOptions {
  double redundant_share = 0.9;  ///< of its close landmarks, seen by other keyframes as well
  int min_observers = 3;         ///< other keyframes that see a landmark as finely
  double close_baselines = 40;   ///< landmarks farther than this do not count
};
/// For check_options().
void describe(kys::OptionList& list, KeyFrameCullingOptions& options);

/// Takes out covisible keyframes of `current` whose close landmarks nearly all are seen by at least
/// three others at the same or a finer scale (ORB-SLAM, Sec. VI-E). Returns how many.
int cull_keyframes(Map& map, KeyFrameId current, const KeyFrameCullingOptions& options);

}  // namespace kys_slam
