// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <optional>

#include "loop_closing/place_verification.h"
#include "retrieval/place_index.h"

namespace kys_slam {

struct RelocalizationOptions {
  bool enabled = true;
  std::size_t candidates = 5;  ///< places verified
  int patience = 10;           ///< frames; Restart says for what
  PlaceVerificationOptions verification;
};
/// For check_options().
void describe(kys::OptionList& list, RelocalizationOptions& options);

/// Relocalises a frame in the map: the verified candidate of the index with most inliers (ORB-SLAM,
/// Sec. V-C). Nothing when no candidate is verified.
/// \param except sub-map that is not searched; invalid: none
std::optional<VerifiedPlace> relocalize(const Map& map, const PlaceIndex& index,
                                        const FrameFeatures& features, KeyFrameId except,
                                        const RelocalizationOptions& options,
                                        const kys::DistanceModel& model,
                                        kys::Statistics& statistics);

}  // namespace kys_slam
