// SPDX-License-Identifier: BSD-3-Clause
#include "motion/motion_of_mode.h"

#include <kys/prior.h>

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "motion/belief.h"

namespace kys_slam {
namespace {

kys::Prior initial_belief(const kys::Prior& prior, const kys::InitialBelief& start) {
  if (!has_belief(prior, start)) return prior;
  return kys::with_belief(prior, probability(start.log_odds(prior)));
}

kys::Prior decided(const kys::Prior& prior) {
  if (prior.dynamic != 0) return prior;
  return kys::make_prior(prior.label, prior.instance, prior.scale, 0.0f, false);
}

}  // namespace

MapContents with_motion_of_mode(MapContents contents, bool beliefs,
                                const kys::InitialBelief& start) {
  if (contents.beliefs == beliefs) return contents;
  contents.beliefs = beliefs;
  const auto convert = [&](const kys::Prior& prior) {
    return beliefs ? initial_belief(prior, start) : decided(prior);
  };
  for (KeyFrame& keyframe : contents.keyframes) {
    const std::span<const kys::Prior> before = keyframe.features->priors();
    if (before.empty()) continue;
    std::vector<kys::Prior> priors;
    priors.reserve(before.size());
    for (const kys::Prior& prior : before) priors.push_back(convert(prior));
    keyframe.features =
        std::make_shared<const FrameFeatures>(keyframe.features->with_priors(std::move(priors)));
  }
  for (Landmark& landmark : contents.landmarks) landmark.prior = convert(landmark.prior);
  return contents;
}

}  // namespace kys_slam
