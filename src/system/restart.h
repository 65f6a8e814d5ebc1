// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace kys_slam {

/// When a lost frame that is not recognised starts a new sub-map.
///
/// A camera that is elsewhere, as after missing images, starts one at once: it has no pose
/// otherwise. Such a sub-map is provisional for `patience` frames: each of them is first searched
/// for in the maps before, and tracking resumes there when it is found, so a loss that passes
/// leaves the old map as it was. A frame whose pose was found and refused starts nothing at once:
/// what refuses it, a moving object, fills the image. Neither does the end of a provisional
/// sub-map. Then `patience` unrecognised frames start one.
class Restart {
 public:
  explicit Restart(int patience) : patience_(patience) {}

  /// Another frame was lost and not recognised, from which a map can start. Whether it does.
  /// \param refused a pose was found and rejected
  [[nodiscard]] bool is_due(bool refused) {
    ++unrecognised_;
    return (!refused && !tried_) || unrecognised_ >= patience_;
  }
  void started() {
    unrecognised_ = 0;
    provisional_ = patience_;
    tried_ = true;
  }
  /// \param known in the map before, or in the sub-map that has been started
  void tracked(bool known) {
    unrecognised_ = 0;
    provisional_ = known || provisional_ == 0 ? 0 : provisional_ - 1;
    if (provisional_ == 0) tried_ = false;
  }
  /// Whether the earlier maps are to be searched for the next frame.
  [[nodiscard]] bool is_provisional() const { return provisional_ > 0; }

 private:
  int patience_;
  int unrecognised_ = 0;  // since the last frame with a pose
  int provisional_ = 0;   // frames for which the sub-map is still provisional
  bool tried_ = false;    // a sub-map has been started at once, and none has lasted since
};

}  // namespace kys_slam
