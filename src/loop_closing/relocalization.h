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
  int patience = 10;  ///< frames that could start a map but are not recognised, until one does
  PlaceVerificationOptions verification;
};
/// For check_options().
void describe(kys::OptionList& list, RelocalizationOptions& options);

/// Where a frame of unknown pose is in the map: the place of the index's candidates that fits it
/// best, verified (ORB-SLAM, Sec. V-C). Nothing when none does.
std::optional<VerifiedPlace> relocalize(const Map& map, const PlaceIndex& index,
                                        const FrameFeatures& features,
                                        const RelocalizationOptions& options,
                                        const kys::DistanceModel& model,
                                        kys::Statistics& statistics);

}  // namespace kys_slam
