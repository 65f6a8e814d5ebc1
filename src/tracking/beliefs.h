// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>

#include <algorithm>
#include <deque>

#include "map/change_set.h"
#include "motion/belief.h"
#include "motion/instance_tracker.h"
#include "optimization/pose_consensus.h"

namespace kys_slam {

/// What is believed now of the instances in a frame, for those who only read it. In modes without
/// belief priors are as their files say.
class Beliefs {
 public:
  /// \param instances null: the mode uses no belief
  /// \param max_log_odds nats, limit of what one instance says about a pose
  Beliefs(const InstanceTracker* instances, const kys::InitialBelief& start,
          const kys::DistanceModel& model, double max_log_odds)
      : instances_(instances), start_(&start), model_(&model), max_log_odds_(max_log_odds) {}

  [[nodiscard]] bool in_use() const { return instances_ != nullptr; }
  [[nodiscard]] kys::Prior with_belief(const kys::Prior& prior) const {
    return instances_ != nullptr ? instances_->with_belief(prior) : prior;
  }
  /// A landmark's prior with the present belief; valid as long as `kept` exists.
  [[nodiscard]] const kys::Prior* of_landmark(const LandmarkView& landmark,
                                              std::deque<kys::Prior>& kept) const {
    if (instances_ == nullptr) return &landmark.prior;
    return &kept.emplace_back(instances_->with_belief(landmark.prior));
  }
  /// Weight of an observation, 0..1.
  [[nodiscard]] float weight(const kys::Prior& prior) const {
    return instances_ != nullptr ? instances_->weight(prior) : 1.0f;
  }
  /// Whether the belief that its instance is static passes the gate (kys.gate_belief), so that it
  /// can be part of the map.
  [[nodiscard]] bool is_static(const kys::Prior& prior) const {
    return instances_ == nullptr ||
           model_->admits(instances_->with_belief(prior), kys::Context::kTemporal);
  }
  /// Whether a match is on an instance that can move: by the prior of the frame, or by that of the
  /// landmark when the frame has none.
  [[nodiscard]] bool can_move(const kys::Prior& keypoint, const kys::Prior& landmark) const {
    return can_move(prior_of_match(keypoint, landmark));
  }
  [[nodiscard]] bool can_move(const kys::Prior& prior) const { return has_belief(prior, *start_); }
  /// Instance of a match on something that can move, and the log-odds that it is static. The belief
  /// comes from earlier poses, which may have been wrong: it is limited.
  [[nodiscard]] Vote vote(const kys::Prior& keypoint, const kys::Prior& landmark) const {
    const kys::Prior& prior = prior_of_match(keypoint, landmark);
    if (!has_belief(prior, *start_)) return {};
    const double odds =
        instances_ != nullptr ? instances_->log_odds(prior.instance) : start_->log_odds(prior);
    return {prior.instance, static_cast<float>(std::clamp(odds, -max_log_odds_, max_log_odds_))};
  }

 private:
  [[nodiscard]] static const kys::Prior& prior_of_match(const kys::Prior& keypoint,
                                                        const kys::Prior& landmark) {
    return keypoint.label != kys::kVoidLabel ? keypoint : landmark;
  }

  const InstanceTracker* instances_;
  const kys::InitialBelief* start_;
  const kys::DistanceModel* model_;
  double max_log_odds_;
};

}  // namespace kys_slam
