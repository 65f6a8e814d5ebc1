// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

#include <kys/prior.h>
#include <kys_slam/check_options.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <utility>

namespace kys_slam {
namespace {

// s; with beliefs, a frame without priors starts no sub-map for this long after one with priors.
constexpr double kPriorGap = 1;

int count_stereo(const FrameFeatures& features) {
  int stereo = 0;
  for (std::size_t i = 0; i < features.size(); ++i) stereo += features.has_stereo(i) ? 1 : 0;
  return stereo;
}

}  // namespace

Tracker::Tracker(const StereoCamera& camera, const ScaleLevels& scales,
                 const TrackerOptions& options, const kys::DistanceModel& model,
                 const kys::InitialBelief& start)
    : camera_(camera),
      scales_(scales),
      options_(options),
      model_(&model),
      start_(start),
      close_depth_(static_cast<float>(options.close_baselines * camera.baseline)),
      patches_(camera, scales),
      covariance_(camera, scales) {
  check_options(options);
  if (model.uses_belief()) {
    instances_.emplace(camera, scales, options.instances, start, model);
  }
}

Tracker::Frame Tracker::make_frame(const TrackerInput& input, TrackResult& result) {
  std::shared_ptr<const FrameFeatures> features = input.features;
  const double taken = result.taken = taken_at(input);
  if (instances_) {
    latest_ = taken;
    const auto is_labelled = [](const kys::Prior& prior) { return prior.label != kys::kVoidLabel; };
    if (std::ranges::any_of(features->priors(), is_labelled)) labelled_ = taken;
    const Rigid3 T_last_w = last_ ? last_->T_c_w : Rigid3{};
    const std::optional<ExpectedPose> motion = expected_pose(taken);
    const Rigid3 expected = motion ? motion->T_c_w : T_last_w;
    std::vector<kys::Prior> priors =
        instances_->assign_priors(taken, *features, expected, T_last_w);
    features = std::make_shared<const FrameFeatures>(features->with_priors(std::move(priors)));
  }
  if (options_.align && input.left != nullptr) {
    features = std::make_shared<const FrameFeatures>(features->with_image_noise());
  }
  Frame frame{input.index,
              input.timestamp,
              taken,
              std::move(features),
              {},
              {},
              {},
              {},
              options_.align ? input.left : nullptr,
              input.segments};
  frame.landmarks.resize(frame.features->size());
  return frame;
}

/// A repeated picture shows what the camera saw before: the next one shows what it has done since.
/// A camera that gives the same one for longer stands still. No picture is taken before one that
/// was there earlier.
double Tracker::taken_at(const TrackerInput& input) {
  const double time = clock_.time_of(input.timestamp);
  if (!last_) return time;
  if (input.repeated && last_->index + 1 == input.index) {
    if (time - last_->taken <= kLongestGuess) return last_->taken;
    if (velocity_) velocity_->T_c_last = Rigid3();
  }
  return std::max(time, last_->taken);
}

void Tracker::continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end,
                           bool frozen) {
  next_keyframe_ = keyframe_id_end;
  landmark_ids_.continue_after(landmark_id_end);
  frozen_ = frozen;
}

TrackResult Tracker::track(const TrackerInput& input, int waiting) {
  TrackResult result;
  Stopwatch watch;
  if (last_) refresh_last_frame();
  Frame frame = make_frame(input, result);
  if (!last_) {
    if (replica_.keyframes().empty()) {
      start_map(frame, result);
    } else {
      result.reason = "not yet found in the map";
    }
    return result;
  }
  bool tracked = predict(frame, result);
  result.times.predict = watch.lap_ms();
  tracked = tracked && track_local_map(frame, result);
  result.times.local_map = watch.lap_ms();
  if (tracked) {
    finish_tracked(std::move(frame), waiting, result);
  } else {
    forget_instance_frames();
  }
  return result;
}

/// A frame with a pose: perhaps a keyframe, and what the next one starts from. False where the pose
/// rests on things that turn out to move.
bool Tracker::finish_tracked(Frame frame, int waiting, TrackResult& result) {
  Stopwatch watch;
  if (result.overruled) result.reason += "; image area against most matches";
  result.held = frame.held.has_value();
  if (result.held) result.reason += "; held by constant velocity";
  if (instances_) judge_instances(frame, result);
  if (result.inliers < std::min(options_.min_held_inliers, options_.min_local_inliers)) {
    result.reason += "; " + std::to_string(result.inliers) + " inliers stand still";
    result.instances.clear();
    forget_instance_frames();
    return false;
  }
  result.status = TrackingStatus::kTracked;
  add_covariance(frame, result);
  if (!frozen_ && needs_keyframe(situation(frame, result.inliers, waiting), options_.keyframes)) {
    result.keyframe = make_keyframe(frame);
  }
  result.times.keyframe = watch.lap_ms();
  keep_as_last(std::move(frame), result);
  return true;
}

TrackResult Tracker::resume(const TrackerInput& input, const KnownPlace& place, int waiting) {
  TrackResult result;
  result.reason = "relocalised";
  result.relocalised = true;
  Stopwatch watch;
  // The back end was waited for: it may have moved the map since track().
  if (last_) refresh_last_frame();
  Frame frame = make_frame(input, result);
  frame.T_c_w = place.T_c_w;
  if (submap(place.reference) == submap(reference_) && !is_possible(frame, result)) return result;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (replica_.landmarks().contains(place.landmarks[i])) frame.landmarks[i] = place.landmarks[i];
  }
  // Where it was before may be another sub-map, with another world.
  const std::optional<Velocity> velocity = std::exchange(velocity_, std::nullopt);
  refine_pose(frame, result);
  const KeyFrameId before = std::exchange(reference_, place.reference);
  const KeyFrameId first = first_keyframe_;
  bool tracked = track_local_map(frame, result);
  result.times.local_map = watch.lap_ms();
  if (tracked) {
    if (submap(reference_) != submap(before)) {
      first_keyframe_ = reference_;
      if (instances_) instances_->forget_velocities();
    }
    tracked = finish_tracked(std::move(frame), waiting, result);
  }
  if (!tracked) {
    reference_ = before;
    first_keyframe_ = first;
    velocity_ = velocity;
  }
  return result;
}

bool Tracker::can_start(const FrameFeatures& features) const {
  // Without priors a map may follow a vehicle. Where files are missing, others follow soon.
  const bool misses_priors = labelled_ && latest_ > *labelled_ && latest_ - *labelled_ <= kPriorGap;
  if (misses_priors) return false;
  return !frozen_ && count_stereo(features) >= options_.min_start_points;
}

TrackResult Tracker::start_submap(const TrackerInput& input) {
  TrackResult result;
  Frame frame = make_frame(input, result);
  const KeyFrameId before = std::exchange(reference_, KeyFrameId{});
  start_map(frame, result);
  if (result.status != TrackingStatus::kStarted) reference_ = before;
  return result;
}

/// A frame with enough stereo points becomes the first keyframe of a map, at the world's origin.
void Tracker::start_map(Frame& frame, TrackResult& result) {
  const int stereo = count_stereo(*frame.features);
  if (stereo < options_.min_start_points) {
    result.reason = "too few stereo points to start a map: " + std::to_string(stereo);
    return;
  }
  result.status = TrackingStatus::kStarted;
  result.reason = "start";
  supported_.reset();
  if (instances_) {
    instances_->forget_velocities();
    judge_instances(frame, result);
  }
  result.keyframe = make_keyframe(frame);
  first_keyframe_ = result.keyframe->id;
  result.inliers = result.matches = static_cast<int>(result.keyframe->new_landmarks.size());
  keep_as_last(std::move(frame), result);
}

/// What the next frame starts from.
void Tracker::keep_as_last(Frame frame, TrackResult& result) {
  const Replica::Anchor anchor = replica_.resolve(reference_);
  frame.pose = {anchor.keyframe,
                frame.T_c_w * replica_.keyframes().at(anchor.keyframe).T_c_w.inverse(),
                replica_.scale()};
  result.pose = frame.pose;
  result.T_c_w = frame.T_c_w;
  // The pose before a relocalisation may be wrong, or of another sub-map.
  if (last_ && last_->index + 1 == frame.index && result.status == TrackingStatus::kTracked &&
      !result.relocalised) {
    const double interval = frame.taken - last_->taken;
    if (interval > 0) velocity_ = {frame.T_c_w * last_->T_c_w.inverse(), interval, frame.taken};
  } else if (result.status != TrackingStatus::kStarted || options_.acceleration <= 0) {
    velocity_.reset();
  }
  if (instances_) {
    // The tracker of instances keeps one frame of a picture that is repeated.
    if (!judged_.empty() && last_ && last_->taken == frame.taken) judged_.pop_front();
    judged_.push_front(frame.pose);
    judged_.resize(std::min(judged_.size(), instances_->frames_kept()));
  }
  last_ = std::move(frame);
  last_->left = nullptr;  // the next frame's image comes into its place
  last_->segments = {};
}

/// What the frame says of its things; landmarks on those that turn out to move are dropped.
void Tracker::judge_instances(Frame& frame, TrackResult& result) {
  std::vector<PoseTerm> terms;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const LandmarkView* landmark = replica_.landmarks().find(frame.landmarks[i]);
    if (landmark == nullptr) continue;
    const kys::Prior& prior = frame.features->prior(i);
    terms.push_back({landmark->p_w, pixel_of(frame, i, *landmark),
                     std::min(belief(prior), belief(landmark->prior)),
                     instances_->follows(prior) ? prior.instance : -1});
  }
  std::vector<Rigid3> past;
  for (const FramePose& pose : judged_) past.push_back(current_pose(pose));
  result.instances = instances_->judge(frame.taken, frame.features, frame.segments, frame.T_c_w,
                                       terms, past, result.statistics);
  bool changed = false;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (!frame.landmarks[i].valid() || is_believed_static(frame.features->prior(i))) continue;
    frame.landmarks[i] = {};
    changed = true;
  }
  if (changed) result.inliers = refine_pose(frame, result);
}

void Tracker::forget_instance_frames() {
  if (!instances_) return;
  instances_->forget_frames();
  judged_.clear();
}

std::shared_ptr<const FrameFeatures> Tracker::with_beliefs(
    std::shared_ptr<const FrameFeatures> features) const {
  if (!instances_) return features;
  std::vector<kys::Prior> priors(features->priors().begin(), features->priors().end());
  for (kys::Prior& prior : priors) prior = instances_->with_belief(prior);
  return std::make_shared<const FrameFeatures>(features->with_priors(std::move(priors)));
}

/// The map may have moved since the last frame: its pose follows its keyframe, its landmarks their
/// successors.
void Tracker::refresh_last_frame() {
  const Rigid3 T_c_w_before = last_->T_c_w;
  const Replica::Anchor anchor = replica_.resolve(last_->pose.reference);
  // The culled keyframe's own frame lies between: T_c_ref_old * T_ref_old_ref_new.
  last_->pose = {anchor.keyframe, last_->pose.at_scale(replica_.scale()) * anchor.T_c_k,
                 replica_.scale()};
  last_->T_c_w = last_->pose.T_c_reference * replica_.keyframes().at(anchor.keyframe).T_c_w;
  for (LandmarkId& id : last_->landmarks) {
    if (id.valid()) id = replica_.resolve(id);
  }
  reference_ = replica_.resolve(reference_).keyframe;
  if (std::exchange(map_moved_, false) && instances_) {
    instances_->turn_world(last_->T_c_w.rotation.conjugate() * T_c_w_before.rotation);
  }
}

Rigid3 Tracker::current_pose(const FramePose& pose) const {
  const Replica::Anchor anchor = replica_.resolve(pose.reference);
  return pose.at_scale(replica_.scale()) * anchor.T_c_k *
         replica_.keyframes().at(anchor.keyframe).T_c_w;
}

KeyFrameId Tracker::submap(KeyFrameId keyframe) const {
  const KeyFrameView* view = replica_.keyframes().find(replica_.resolve(keyframe).keyframe);
  return view != nullptr ? view->submap : KeyFrameId{};
}

}  // namespace kys_slam
