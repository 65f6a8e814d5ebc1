// SPDX-License-Identifier: BSD-3-Clause
#include "system/late_segments.h"

#include <algorithm>
#include <utility>

#include "geometry/so3.h"

namespace kys_slam {

LateSegments::LateSegments(const StereoCamera& camera, const ScaleLevels& scales,
                           const InstanceTrackerOptions& options, const kys::DistanceModel& model,
                           const kys::InitialBelief& start, std::vector<std::uint8_t> is_thing,
                           double memory)
    : camera_(camera),
      scales_(scales),
      search_{scales, &model, static_cast<float>(options.search_radius),
              static_cast<float>(options.descriptor_distance),
              static_cast<float>(options.descriptor_ratio)},
      start_(start),
      is_thing_(std::move(is_thing)),
      memory_(memory),
      before_(std::make_shared<const State>(
          State{{InstanceTracker(camera, scales, options, start, model), {}, {}}, {}})) {}

void LateSegments::continue_after(std::int32_t instance_end) {
  next_identity_ = std::max(next_identity_, instance_end);
}

/// Another world, or another place in it.
void LateSegments::forget() {
  State state = latest_state();
  state.judged.instances.forget_frames();
  state.judged.instances.forget_velocities();
  state.judged.poses.clear();
  state.carried.reset();
  before_ = std::make_shared<const State>(std::move(state));
  frames_.clear();
  older_.clear();
}

/// A pose by constant velocity.
std::optional<Rigid3> LateSegments::expected_pose(double timestamp, const Tracker& tracker) const {
  if (frames_.empty() || !frames_.back().pose) return std::nullopt;
  const Frame& last = frames_.back();
  const Rigid3 T_last_w = tracker.current_pose(*last.pose);
  if (frames_.size() < 2) return T_last_w;
  const Frame& before = frames_[frames_.size() - 2];
  if (!before.pose || last.taken <= before.taken) return T_last_w;
  const Rigid3 step = T_last_w * tracker.current_pose(*before.pose).inverse();
  const double ratio = (timestamp - last.taken) / (last.taken - before.taken);
  return plus_left(Rigid3{}, ratio * left_increment(step)) * T_last_w;
}

LateSegments::Carried LateSegments::begin(std::shared_ptr<const SegmentImage> image,
                                          const Frame& frame, std::vector<kys::Prior> named) const {
  Carried carried;
  carried.segments = std::make_shared<const SegmentCarrier>(
      camera_, std::move(image), std::move(named), frame.features, is_thing_);
  carried.pose = *frame.pose;
  carried.taken = carried.until = frame.taken;
  carried.moved.assign(carried.segments->segments().size(), Eigen::Vector3d::Zero());
  carried.known.assign(carried.moved.size(), 0);
  return carried;
}

/// Motion up to a time, by the last known velocities; in the axes of the camera of the image.
SegmentShifts LateSegments::shifts_at(const Carried& carried, double taken,
                                      const InstanceTracker& beliefs, const Rigid3& T_s_w) const {
  Carried then = carried;
  advance(then, taken, beliefs);
  for (Eigen::Vector3d& shift : then.moved) shift = T_s_w.rotation * shift;
  return then.moved;
}

/// Adds the motion since the last time; that of an instance whose velocity is new since its image.
void LateSegments::advance(Carried& carried, double taken, const InstanceTracker& beliefs) const {
  const std::span<const kys::Prior> segments = carried.segments->segments();
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const std::optional<Eigen::Vector3d> velocity = beliefs.velocity(segments[k]);
    if (!velocity) continue;
    const double since = carried.known[k] != 0 ? carried.until : carried.taken;
    carried.moved[k] += *velocity * (taken - since);
    carried.known[k] = 1;
  }
  carried.until = taken;
}

std::vector<kys::Prior> LateSegments::priors_at(const Carried& carried, double taken,
                                                const Rigid3& T_c_w, const FrameFeatures& features,
                                                const InstanceTracker& beliefs,
                                                const Tracker& tracker) const {
  const Rigid3 T_s_w = tracker.current_pose(carried.pose);
  return carried.segments->priors_of(carried.segments->carry(
      features, T_s_w * T_c_w.inverse(), shifts_at(carried, taken, beliefs, T_s_w), &search_));
}

/// Priors of the segments of an image with identities over time.
/// \param T_c_w pose of its frame
/// \param beliefs as of the frame before
/// \param before the segmentation whose identities go on; null: none
std::vector<kys::Prior> LateSegments::name(const SegmentImage& image, const Frame& frame,
                                           const Rigid3& T_c_w, const InstanceTracker& beliefs,
                                           const Carried* before, const Tracker& tracker) {
  std::vector<kys::Prior> named = image.segments;
  const auto is_thing = [&](const kys::Prior& prior) {
    return prior.label < is_thing_.size() && is_thing_[prior.label] != 0;
  };
  for (kys::Prior& prior : named) prior.instance = is_thing(prior) ? -1 : prior.label;
  if (before != nullptr) {
    const SegmentCarrier now(camera_, std::make_shared<const SegmentImage>(image), named,
                             frame.features, is_thing_, false);
    take_names(*before, now, T_c_w, frame.taken, beliefs, tracker, named);
    // What the last segmentation missed was there before.
    for (const Carried& older : older_) {
      if (frame.taken - older.taken > memory_) break;
      take_names(older, now, T_c_w, frame.taken, beliefs, tracker, named);
    }
  }
  for (kys::Prior& prior : named) {
    if (prior.instance < 0) prior.instance = next_identity_++;
  }
  return named;
}

/// Instances without an identity get those of an earlier segmentation that nothing else has.
void LateSegments::take_names(const Carried& before, const SegmentCarrier& now, const Rigid3& T_c_w,
                              double taken, const InstanceTracker& beliefs, const Tracker& tracker,
                              std::vector<kys::Prior>& named) const {
  const auto nameless = [](const kys::Prior& prior) { return prior.instance < 0; };
  if (std::ranges::none_of(named, nameless)) return;
  const Rigid3 T_s_w = tracker.current_pose(before.pose);
  const std::vector<std::uint16_t> same =
      same_segments(*before.segments, now, T_s_w * T_c_w.inverse(),
                    shifts_at(before, taken, beliefs, T_s_w), start_);
  for (std::size_t k = 0; k < named.size(); ++k) {
    if (!nameless(named[k]) || same[k] == 0) continue;
    const std::int32_t instance = before.segments->segments()[same[k] - 1U].instance;
    if (std::ranges::find(named, instance, &kys::Prior::instance) == named.end()) {
      named[k].instance = instance;
    }
  }
}

/// The last segmentation gives way to a new one.
void LateSegments::keep_older(const std::optional<Carried>& last) {
  if (!last) return;
  older_.push_front(*last);
  if (older_.size() > kOlder) older_.pop_back();
}

/// What the frame shows of its instances, as FrameInstances::judge.
void LateSegments::judge(Judged& judged, const Frame& frame, const std::vector<kys::Prior>& priors,
                         std::span<const kys::Prior> segments, const Tracker& tracker) const {
  if (!frame.pose) {
    judged.instances.forget_frames();
    judged.poses.clear();
    return;
  }
  const Rigid3 T_c_w = tracker.current_pose(*frame.pose);
  std::vector<Rigid3> past;
  for (const FramePose& pose : judged.poses) past.push_back(tracker.current_pose(pose));
  const Rigid3 T_last_w = past.empty() ? T_c_w : past.front();
  if (!past.empty()) {
    judged.instances.turn_world(past.front().rotation.conjugate() * judged.T_c_w.rotation);
  }
  std::vector<kys::Prior> believed = judged.instances.assign_priors(
      frame.taken, frame.features->with_priors(priors), T_c_w, T_last_w);
  const auto features =
      std::make_shared<const FrameFeatures>(frame.features->with_priors(std::move(believed)));
  std::vector<PoseTerm> terms;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (!frame.landmarks[i].valid()) continue;
    const LandmarkView* landmark =
        tracker.replica().landmarks().find(tracker.replica().resolve(frame.landmarks[i]));
    if (landmark == nullptr) continue;
    const kys::Prior& prior = features->prior(i);
    terms.push_back({landmark->p_w, features->stereo_pixel(i, scales_),
                     judged.instances.weight(prior),
                     judged.instances.follows(prior) ? prior.instance : -1});
  }
  kys::Statistics statistics;
  judged.instances.judge(frame.taken, features, segments, T_c_w, terms, past, statistics);
  if (judged.taken == frame.taken && !judged.poses.empty()) judged.poses.pop_front();
  judged.poses.push_front(*frame.pose);
  judged.poses.resize(std::min(judged.poses.size(), judged.instances.frames_kept()));
  judged.taken = frame.taken;
  judged.T_c_w = T_c_w;
}

/// The frames from `first` on, with priors carried to them.
void LateSegments::replay(State& state, std::size_t first, const Tracker& tracker,
                          std::vector<LatePriors>& late) {
  for (std::size_t i = first; i < frames_.size(); ++i) {
    Frame& frame = frames_[i];
    std::vector<kys::Prior> priors;
    if (frame.pose) {
      priors = priors_at(*state.carried, frame.taken, tracker.current_pose(*frame.pose),
                         *frame.features, state.judged.instances, tracker);
    }
    judge(state.judged, frame, priors, {}, tracker);
    advance(*state.carried, frame.taken, state.judged.instances);
    frame.after = std::make_shared<const State>(state);
    if (frame.pose) late.push_back({frame.index, frame.keyframe, std::move(priors)});
  }
}

bool LateSegments::arrive(std::int64_t index, std::shared_ptr<const SegmentImage> image,
                          std::int64_t now, double timestamp,
                          const std::shared_ptr<const FrameFeatures>& features, Tracker& tracker) {
  if (index <= base_frame_ || index > now) return false;
  if (index == now) {
    const std::optional<Rigid3> expected = expected_pose(timestamp, tracker);
    const std::optional<Carried>& carried = latest_state().carried;
    Frame frame;
    frame.taken = timestamp;
    frame.features = features;
    own_named_ = name(*image, frame, expected.value_or(Rigid3{}), beliefs(tracker),
                      expected && carried ? &*carried : nullptr, tracker);
    own_image_ = std::move(image);
    return true;
  }
  const auto at = std::ranges::find(frames_, index, &Frame::index);
  if (at == frames_.end() || !at->pose) return false;
  const auto s = static_cast<std::size_t>(at - frames_.begin());
  State state = s > 0 ? *frames_[s - 1].after : *before_;
  const std::optional<Carried> last = std::move(state.carried);
  std::vector<kys::Prior> named = name(*image, *at, tracker.current_pose(*at->pose),
                                       state.judged.instances, last ? &*last : nullptr, tracker);
  keep_older(last);
  state.carried = begin(std::move(image), *at, std::move(named));
  const SegmentCarrier& segments = *state.carried->segments;
  std::vector<LatePriors> late{{index, at->keyframe, segments.priors_of(segments.own())}};
  judge(state.judged, *at, late.front().priors, segments.segments(), tracker);
  at->after = std::make_shared<const State>(state);
  base_frame_ = index;
  replay(state, s + 1, tracker, late);
  tracker.apply(std::move(late), state.judged.instances, std::move(state.judged.poses));
  return true;
}

std::vector<kys::Prior> LateSegments::carry(double timestamp, const FrameFeatures& features,
                                            const Tracker& tracker) {
  if (own_image_) {
    // Its own segments: looked up as they are.
    const SegmentCarrier own(camera_, own_image_, own_named_,
                             std::make_shared<const FrameFeatures>(features), is_thing_, false);
    return own.priors_of(own.own());
  }
  const std::optional<Carried>& carried = latest_state().carried;
  if (!carried || timestamp - carried->taken > memory_) return {};
  const std::optional<Rigid3> expected = expected_pose(timestamp, tracker);
  if (!expected) return {};
  return priors_at(*carried, timestamp, *expected, features, beliefs(tracker), tracker);
}

void LateSegments::add(std::int64_t index, const TrackResult& tracked,
                       std::shared_ptr<const FrameFeatures> features, const Tracker& tracker) {
  const bool lost = tracked.status == TrackingStatus::kLost;
  if (!lost && (tracked.status == TrackingStatus::kStarted || tracked.relocalised)) forget();
  Frame frame;
  frame.index = index;
  frame.taken = tracked.taken;
  frame.features = std::move(features);
  if (!lost) {
    frame.pose = tracked.pose;
    const std::span<const LandmarkId> landmarks = tracker.last_landmarks();
    frame.landmarks.assign(landmarks.begin(), landmarks.end());
    if (tracked.keyframe) frame.keyframe = tracked.keyframe->id;
  }
  const FrameInstances& live = tracker.instances();
  std::optional<Carried> carried = latest_state().carried;
  Judged judged = live.in_use() ? Judged{*live.tracker(), live.judged(),
                                         lost ? Rigid3{} : tracked.T_c_w, frame.taken}
                                : latest_state().judged;
  if (!live.in_use()) {
    const auto priors = frame.features->priors();
    judge(judged, frame, {priors.begin(), priors.end()}, {}, tracker);
  }
  const std::shared_ptr<const SegmentImage> image = std::exchange(own_image_, nullptr);
  std::vector<kys::Prior> named = std::exchange(own_named_, {});
  if (image && frame.pose) {
    keep_older(carried);
    carried = begin(image, frame, std::move(named));
    base_frame_ = index;
  } else if (carried && frame.pose) {
    advance(*carried, frame.taken, judged.instances);
  }
  frame.after = std::make_shared<const State>(State{std::move(judged), std::move(carried)});
  frames_.push_back(std::move(frame));
  if (frames_.size() > kMostFrames) {
    before_ = frames_.front().after;
    frames_.pop_front();
  }
}

}  // namespace kys_slam
