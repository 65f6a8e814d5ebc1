// SPDX-License-Identifier: BSD-3-Clause
#include "refine_in_rounds.h"

namespace kys_slam {

RoundsResult refine_in_rounds(SavedMap& map, const MapSelection& selection,
                              RefinementOptions options, int associations,
                              MapObservations& observations) {
  const Watch watch = options.watch;
  int done = 0;  // iterations
  if (watch.progress) {
    options.watch.progress = [&](int of_round, int most, const std::string& what) {
      watch.progress(done + of_round, most * (associations + 1), what);
    };
  }
  options.compared_with = observations.rig;
  RoundsResult result;
  result.first = result.last = refine(observations, options);
  for (int k = 0; k < associations && !result.last.stopped; ++k) {
    if (!observations.rig.correction.parameters().allFinite() ||
        !observations.rig.covariance.allFinite()) {
      break;  // the caller says so
    }
    done = result.last.iterations;
    map.update(observations);
    result.associations.push_back(map.associate());
    observations = map.observations(selection);
    result.last = refine(observations, options);
    result.last.iterations += done;
  }
  result.last.before = result.first.before;
  return result;
}

}  // namespace kys_slam
