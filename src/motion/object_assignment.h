// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "motion/object_filter.h"
#include "motion/object_tracks.h"

namespace kys_slam::objects {

/// An observation, by its index in its frame.
struct Seen {
  std::size_t frame = 0;
  std::size_t observation = 0;
  bool used = true;  // for position and velocity
};

/// An object that is tracked. The first observations may be without place: they came before the one
/// that started it.
struct Track {
  std::int32_t identity = 0;
  std::int32_t instance = 0;  // the name under which it was seen last
  std::uint16_t label = 0;
  std::vector<Seen> seen;
  std::vector<Seen> astray;                          // after these, of its name, elsewhere
  double time = 0;                                   // s, of the last one seen
  Gaussian state;                                    // then
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // m, seen last, in the world
};

/// Assigns observations to tracks, frame by frame.
std::vector<Track> assign_observations(std::span<const ObjectFrame> frames,
                                       const ObjectTrackOptions& options);

}  // namespace kys_slam::objects
