// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "map/ids.h"

namespace kys_slam {

/// A keyframe that may show the same place as the query.
struct PlaceCandidate {
  KeyFrameId keyframe;
  double score = 0;  ///< see PlaceIndex::query
  int votes = 0;     ///< features of the query that vote for this keyframe
  friend bool operator==(const PlaceCandidate&, const PlaceCandidate&) = default;
};

}  // namespace kys_slam
