// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>

#include "map/map_contents.h"

namespace kys_slam {

/// The contents of a saved map for a run whose mode has beliefs in the priors' motion, or mu.
/// Unchanged when the map has the same. Mu becomes the initial belief by class and flag, where a
/// class can move; a belief that something is static becomes mu = 0, and one that it moves stays a
/// large mu.
/// \param start initial beliefs; used with `beliefs` only
MapContents with_motion_of_mode(MapContents contents, bool beliefs,
                                const kys::InitialBelief& start);

}  // namespace kys_slam
