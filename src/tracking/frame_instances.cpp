// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/frame_instances.h"

#include <algorithm>
#include <utility>

#include "tracking/pose_estimation.h"
#include "tracking/replica_poses.h"

namespace kys_slam {

FrameInstances::FrameInstances(const StereoCamera& camera, const ScaleLevels& scales,
                               const TrackerOptions& options, const kys::DistanceModel& model,
                               const kys::InitialBelief& start)
    : model_(&model),
      start_(start),
      max_vote_(options.max_instance_evidence),
      prior_gap_(options.prior_gap) {
  if (model.uses_belief()) tracker_.emplace(camera, scales, options.instances, start, model);
}

void FrameInstances::replace(const InstanceTracker& tracker, std::deque<FramePose> judged) {
  if (!tracker_) return;
  tracker_ = tracker;
  judged_ = std::move(judged);
  labelled_ = latest_;
}

std::shared_ptr<const FrameFeatures> FrameInstances::assign_priors(double taken,
                                                                   const FrameFeatures& features,
                                                                   const Rigid3& T_c_w_expected,
                                                                   const Rigid3& T_last_w) {
  latest_ = taken;
  const auto is_labelled = [](const kys::Prior& prior) { return prior.label != kys::kVoidLabel; };
  if (std::ranges::any_of(features.priors(), is_labelled)) labelled_ = taken;
  return std::make_shared<const FrameFeatures>(
      features.with_priors(tracker_->assign_priors(taken, features, T_c_w_expected, T_last_w)));
}

std::vector<InstanceState> FrameInstances::judge(const TrackingContext& c,
                                                 const TrackedFrame& frame,
                                                 kys::Statistics& statistics) {
  std::vector<PoseTerm> terms;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const LandmarkView* landmark = c.replica.landmarks().find(frame.landmarks[i]);
    if (landmark == nullptr) continue;
    const kys::Prior& prior = frame.features->prior(i);
    terms.push_back({landmark->p_w, pixel_of(c, *frame.features, i, landmark->observers.size()),
                     std::min(c.beliefs.weight(prior), c.beliefs.weight(landmark->prior)),
                     tracker_->follows(prior) ? prior.instance : -1});
  }
  std::vector<Rigid3> past;
  for (const FramePose& pose : judged_) past.push_back(current_pose(c.replica, pose));
  return tracker_->judge(frame.taken, frame.features, frame.segments, frame.T_c_w, terms, past,
                         statistics);
}

void FrameInstances::keep(const FramePose& pose, bool again) {
  if (!tracker_) return;
  if (!judged_.empty() && again) judged_.pop_front();
  judged_.push_front(pose);
  judged_.resize(std::min(judged_.size(), tracker_->frames_kept()));
}

void FrameInstances::forget_frames() {
  if (!tracker_) return;
  tracker_->forget_frames();
  judged_.clear();
}

void FrameInstances::forget_velocities() {
  if (tracker_) tracker_->forget_velocities();
}

void FrameInstances::turn_world(const Eigen::Quaterniond& R_new_old) {
  if (tracker_) tracker_->turn_world(R_new_old);
}

std::shared_ptr<const FrameFeatures> FrameInstances::with_beliefs(
    std::shared_ptr<const FrameFeatures> features) const {
  if (!tracker_) return features;
  std::vector<kys::Prior> priors(features->priors().begin(), features->priors().end());
  for (kys::Prior& prior : priors) prior = tracker_->with_belief(prior);
  return std::make_shared<const FrameFeatures>(features->with_priors(std::move(priors)));
}

std::vector<InstanceBelief> FrameInstances::take_changed() {
  return tracker_ ? tracker_->take_changed_beliefs() : std::vector<InstanceBelief>{};
}

}  // namespace kys_slam
