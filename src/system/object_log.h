// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>
#include <kys_slam/object.h>
#include <kys_slam/report.h>

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "motion/instance_tracker.h"
#include "motion/object_tracks.h"

namespace kys_slam {

struct ObjectOptions {
  double min_probability = 0.5;  ///< of moving; instances below start no track
  /// of moving; an instance between the two continues a track, also before its start; one below
  /// only between such frames
  double keep_probability = 0.2;
  int min_keypoints = 1;  ///< stereo keypoints; instances with fewer start no track
  ObjectTrackOptions tracks;
};
/// For check_options().
void describe(kys::OptionList& list, ObjectOptions& options);

/// Observations of moving objects in all frames, stored until the poses are final.
class ObjectLog {
 public:
  explicit ObjectLog(const ObjectOptions& options) : options_(checked(options)) {}

  /// Adds the next frame.
  /// \param taken  s, when its image was taken; that of the frame before for a repeated image
  /// \param instances of the frame; empty when it has no pose
  void add(double taken, std::span<const InstanceState> instances);
  /// Takes back the last `count` frames, which had no instances.
  void take_back(std::size_t count) { frames_.resize(frames_.size() - count); }
  /// Objects over all frames. \param trajectory  one estimate per frame added
  [[nodiscard]] std::vector<ObjectEstimate> objects(
      std::span<const FrameEstimate> trajectory) const;

 private:
  ObjectOptions options_;
  std::vector<ObjectFrame> frames_;
  std::map<std::int32_t, double> last_likely_;  // s, of an instance that may move
};

}  // namespace kys_slam
