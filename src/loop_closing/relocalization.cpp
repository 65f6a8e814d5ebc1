#include "loop_closing/relocalization.h"

#include <utility>

namespace kys_slam {

std::optional<VerifiedPlace> relocalize(const Map& map, const PlaceIndex& index,
                                        const FrameFeatures& features,
                                        const RelocalizationOptions& options,
                                        const kys::DistanceModel& model,
                                        kys::Statistics& statistics) {
  if (!options.enabled) return std::nullopt;
  std::optional<VerifiedPlace> best;
  for (const PlaceCandidate& candidate :
       index.query(features, model, statistics, {}, options.candidates)) {
    if (!map.has(candidate.keyframe)) continue;
    std::optional<VerifiedPlace> place =
        verify_place(map, features, candidate.keyframe, options.verification, model, statistics);
    if (place && (!best || place->inliers > best->inliers)) best = std::move(place);
  }
  return best;
}

}  // namespace kys_slam
