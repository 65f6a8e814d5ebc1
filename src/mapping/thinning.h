// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <vector>

#include "map/map.h"

namespace kys_slam {

struct ThinningOptions {
  int patience = 50;  ///< keyframes since one was last covisible with the newest; 0: never
};
/// For check_options().
void describe(kys::OptionList& list, ThinningOptions& options);

/// Features without a landmark are kept for triangulation and fusion with later keyframes.
/// Keyframes that have not been covisible for long remove theirs, two thirds of their memory. Place
/// recognition and relocalisation are not affected: they use landmarks and their observations.
class Thinning {
 public:
  explicit Thinning(const ThinningOptions& options) : options_(checked(options)) {}
  /// Continues a loaded map; call it before the first keyframe.
  void continue_map(const Map& map);
  /// Call it after local mapping of a keyframe. Returns the number of keyframes thinned.
  int update(Map& map, KeyFrameId current);

 private:
  struct FullKeyFrame {
    KeyFrameId keyframe;
    KeyFrameId last_use;  // newest keyframe that was covisible with it
  };
  ThinningOptions options_;
  std::vector<FullKeyFrame> full_;  // keyframes with all their features, by id
};

}  // namespace kys_slam
