// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/relocalization.h"

#include <utility>
#include <vector>

namespace kys_slam {

void describe(kys::OptionList& list, RelocalizationOptions& o) {
  list.add("relocalization.enabled", o.enabled,
           "search the whole map for lost frames, start a new sub-map when that fails");
  list.add("relocalization.candidates", o.candidates, {0, 100}, "", "places verified per frame");
  list.add("relocalization.patience", o.patience, {1, 1e9}, "frames",
           "for which a new sub-map is provisional, and unrecognised ones after which a doubtful "
           "one starts");
  const kys::OptionList::Fixed fixed(list);
  describe(list, o.verification);  // set as place.*
}

/// A lost frame has no neighbours yet that could confirm a place, so the single frame must pass the
/// same strict verification as a loop. Of several places that pass, the one with most inliers is
/// the nearest view.
std::optional<VerifiedPlace> relocalize(const Map& map, const PlaceIndex& index,
                                        const FrameFeatures& features, KeyFrameId except,
                                        const RelocalizationOptions& options,
                                        const kys::DistanceModel& model,
                                        kys::Statistics& statistics) {
  if (!options.enabled) return std::nullopt;
  std::optional<VerifiedPlace> best;
  std::vector<KeyFrameId> excluded;
  if (except.valid()) excluded = map.submap_keyframes(except);
  for (const PlaceCandidate& candidate :
       index.query(features, model, statistics, excluded, options.candidates)) {
    if (!map.has(candidate.keyframe)) continue;
    std::optional<VerifiedPlace> place =
        verify_place(map, features, candidate.keyframe, options.verification, model, statistics);
    if (place && (!best || place->inliers > best->inliers)) best = std::move(place);
  }
  return best;
}

}  // namespace kys_slam
