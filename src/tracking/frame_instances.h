// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "motion/instance_tracker.h"
#include "tracking/beliefs.h"
#include "tracking/tracked_frame.h"

namespace kys_slam {

struct TrackingContext;
struct TrackerOptions;

/// Instances in the frames that are tracked, and what is believed of them: the tracker's side of
/// InstanceTracker. In modes without belief everything is as the prior files say.
class FrameInstances {
 public:
  /// \param model must outlive it
  FrameInstances(const StereoCamera& camera, const ScaleLevels& scales,
                 const TrackerOptions& options, const kys::DistanceModel& model,
                 const kys::InitialBelief& start);

  [[nodiscard]] bool in_use() const { return tracker_.has_value(); }
  [[nodiscard]] Beliefs beliefs() const {
    return {tracker_ ? &*tracker_ : nullptr, start_, *model_, max_vote_};
  }
  /// Beliefs after the last frame; null: the mode has none.
  [[nodiscard]] const InstanceTracker* tracker() const { return tracker_ ? &*tracker_ : nullptr; }
  /// Poses of the frames that it keeps, latest first.
  [[nodiscard]] const std::deque<FramePose>& judged() const { return judged_; }
  /// Takes other beliefs after the last frame, which has priors by now.
  void replace(const InstanceTracker& tracker, std::deque<FramePose> judged);
  /// Priors of a frame: see InstanceTracker::assign_priors.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> assign_priors(double taken,
                                                                   const FrameFeatures& features,
                                                                   const Rigid3& T_c_w_expected,
                                                                   const Rigid3& T_last_w);
  /// What a frame with a pose says of its instances: see InstanceTracker::judge.
  std::vector<InstanceState> judge(const TrackingContext& context, const TrackedFrame& frame,
                                   kys::Statistics& statistics);
  /// Keeps a judged frame for the comparison with later ones.
  /// \param again it shows the image of the frame before, of which one is kept
  void keep(const FramePose& pose, bool again);
  /// Call it for a lost frame.
  void forget_frames();
  /// Call it in a new world.
  void forget_velocities();
  /// Call it when the world has turned.
  void turn_world(const Eigen::Quaterniond& R_new_old);
  /// The features with present beliefs.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> with_beliefs(
      std::shared_ptr<const FrameFeatures> features) const;
  /// Beliefs that changed since the last call.
  [[nodiscard]] std::vector<InstanceBelief> take_changed();
  /// Whether the last frame has no priors while others shortly before had some: without them a map
  /// may follow a vehicle, and others come soon where files are missing.
  [[nodiscard]] bool misses_priors() const {
    return labelled_ && latest_ > *labelled_ && latest_ - *labelled_ <= prior_gap_;
  }

 private:
  const kys::DistanceModel* model_;
  kys::InitialBelief start_;
  double max_vote_;                         // nats
  double prior_gap_;                        // s
  std::optional<InstanceTracker> tracker_;  // when the model uses belief
  std::deque<FramePose> judged_;            // of the frames it keeps, latest first
  double latest_ = 0;                       // s, of the last frame
  std::optional<double> labelled_;          // s, of the last frame with priors
};

}  // namespace kys_slam
