// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <cstddef>
#include <vector>

#include "map/map.h"

namespace kys_slam {

struct SparsificationOptions {
  /// Landmarks that the keyframes before and after one share, per landmark of it: with more it is
  /// culled. 1: never.
  double overlap = 1;
};
/// For check_options().
void describe(kys::OptionList& list, SparsificationOptions& options);

/// The newest keyframes are dense: every observation makes landmarks and poses more certain. Once a
/// keyframe has left the window of local bundle adjustment, and those that it holds, they have done
/// so; to find a place again and to close loops fewer keyframes are enough. So a keyframe that
/// leaves is culled where its neighbours in time share enough landmarks: the spacing of what is
/// kept follows the scene, whatever the rate of frames. What a culled one observed is lost to the
/// bundle adjustment after a loop, which is why none is by default (configs/lean.yaml). Terms for
/// the motions between the neighbours of culled ones, as they were before the loop, do not make up
/// for it.
class Sparsification {
 public:
  explicit Sparsification(const SparsificationOptions& options) : options_(checked(options)) {}
  /// Call it for every keyframe.
  void add(KeyFrameId id) {
    if (options_.overlap < 1) dense_.push_back(id);
  }
  /// Call it after local bundle adjustment.
  /// \param window the keyframes that were adjusted or held, by id
  /// \return keyframes culled
  int update(Map& map, const std::vector<KeyFrameId>& window);
  /// Keyframes culled so far.
  [[nodiscard]] std::size_t culled() const { return culled_; }

 private:
  SparsificationOptions options_;
  std::vector<KeyFrameId> dense_;  // not judged yet, by id
  std::size_t culled_ = 0;
};

}  // namespace kys_slam
