// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

// What is learned of earlier frames after they were tracked.

#include <utility>

namespace kys_slam {

void Tracker::apply(std::vector<LatePriors> late, const InstanceTracker& instances,
                    std::deque<FramePose> judged) {
  instances_.replace(instances, std::move(judged));
  for (LatePriors& frame : late) {
    for (kys::Prior& prior : frame.priors) prior = with_belief(prior);
    if (last_ && last_->index == frame.frame && last_->features->size() == frame.priors.size()) {
      last_->features =
          std::make_shared<const FrameFeatures>(last_->features->with_priors(frame.priors));
    }
    if (!frame.keyframe) continue;
    replica_.set_priors(*frame.keyframe, frame.priors);
    late_.push_back({*frame.keyframe, std::move(frame.priors)});
  }
}

}  // namespace kys_slam
