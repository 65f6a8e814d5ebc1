#include "map/motion_of_mode.h"

#include <kys/prior.h>

#include <cmath>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

kys::Prior initial_belief(const kys::Prior& prior, const kys::InitialBelief& start) {
  if (prior.instance < 0 || start.mobility(prior.label) == kys::Mobility::kFixed) return prior;
  return kys::with_belief(prior, 1.0 / (1.0 + std::exp(-start.log_odds(prior))));
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
