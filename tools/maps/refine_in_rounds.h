// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/saved_map.h>

#include <vector>

#include "refinement.h"

namespace kys_slam {

struct RoundsResult {
  RefinementResult first;  ///< of the observations that the map had
  RefinementResult last;   ///< the same, or of those found anew; `before`, `iterations`: of all
  std::vector<AssociationReport> associations;
};

/// Refines a map, finds its observations anew by the result, and refines it again, `associations`
/// times: a map that was made with a wrong calibration has the observations that agree with that
/// one. An interrupt keeps the best so far.
/// \param map of which observations are taken; its last adjustment is in the result, not in it
/// \param observations of the last adjustment
RoundsResult refine_in_rounds(SavedMap& map, const MapSelection& selection,
                              RefinementOptions options, int associations,
                              MapObservations& observations);

}  // namespace kys_slam
