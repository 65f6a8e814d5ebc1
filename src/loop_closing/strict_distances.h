// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/distance_quantiles.h>

#include "loop_closing/loop_closer.h"
#include "retrieval/place_index.h"

/// Options with distances as strict for the descriptors of an extractor as they are for ORB.
namespace kys_slam {

inline void make_strict(const DistanceQuantiles& distances, PlaceVerificationOptions& o) {
  o.descriptor_distance = equivalent_distance(o.descriptor_distance, distances);
  o.search_distance = equivalent_distance(o.search_distance, distances);
}

inline void make_strict(const DistanceQuantiles& distances, FusionOptions& o) {
  o.max_distance = equivalent_distance(o.max_distance, distances);
}

inline void make_strict(const DistanceQuantiles& distances, LoopOptions& o) {
  make_strict(distances, o.verification);
  make_strict(distances, o.fusion);
}

inline PlaceOptions strict_places(const DistanceQuantiles& distances, PlaceOptions o = {}) {
  if (!distances.measured()) return o;
  const float least = equivalent_distance(o.max_distance - o.margin, distances);
  o.max_distance = equivalent_distance(o.max_distance, distances);
  o.margin = o.max_distance - least;
  return o;
}

}  // namespace kys_slam
