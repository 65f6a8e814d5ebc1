#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <vector>

#include "map/map.h"

namespace kys_slam {

struct ThinningOptions {
  int patience = 50;  ///< keyframes made since one was last covisible with the newest; 0: never
};
/// For check_options().
void describe(kys::OptionList& list, ThinningOptions& options);

/// Features that see no landmark wait for a keyframe that shows the same corner: to triangulate
/// with, to be fused with. Keyframes left behind long ago drop theirs, two thirds of their memory.
/// What recognises places and frames there, landmarks and who sees them, stays.
class Thinning {
 public:
  explicit Thinning(const ThinningOptions& options) : options_(checked(options)) {}
  /// Before the first keyframe of a map that has been worked on before.
  void continue_map(const Map& map);
  /// After local mapping of a keyframe. Returns how many keyframes were thinned.
  int update(Map& map, KeyFrameId current);

 private:
  struct Whole {
    KeyFrameId keyframe;
    KeyFrameId last_use;  // newest keyframe that was covisible with it
  };
  ThinningOptions options_;
  std::vector<Whole> whole_;  // keyframes with all their features, by id
};

}  // namespace kys_slam
