// SPDX-License-Identifier: BSD-3-Clause
#include "motion/instance_tracker.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "matching/landmark_search.h"
#include "motion/common_shift.h"
#include "motion/follow_back.h"

namespace kys_slam {

void describe(kys::OptionList& list, BeliefUpdateOptions& o) {
  list.add("belief.change_rate", o.change_rate, {0, 100}, "1/s",
           "rate of changes between static and moving");
  list.add("belief.max_evidence", o.max_evidence, {0.001, 100}, "nats",
           "limit of the evidence of one frame");
  list.add("belief.max_log_odds", o.max_log_odds, {0.1, 20}, "nats",
           "limit of the absolute log-odds");
}

void describe(kys::OptionList& list, InstanceTrackerOptions& o) {
  describe(list, o.motion);
  list.add("motion.max_frames", o.max_frames, {1, 100}, "frames",
           "largest number of frames between the two compared");
  list.add("motion.kept_share", o.kept_share, {0.01, 1}, "",
           "share of its matches that a longer span must keep");
  list.add("motion.max_matches", o.max_matches, {3, 60000}, "",
           "largest number of keypoints tracked per instance");
  list.add("motion.max_speed", o.max_speed, {0.01, 1000}, "m/s",
           "limit for instances of unknown motion");
  list.add("motion.max_turn", o.max_turn, {0.001, 100}, "rad/s", "limit for instances");
  list.add("motion.max_acceleration", o.max_acceleration, {0, 1000}, "m/s^2",
           "limit for instances of known motion");
  list.add("motion.search_radius", o.search_radius, {0.5, 1000}, "px",
           "around a predicted keypoint at octave 0");
  list.add("motion.max_search", o.max_search, {0.5, 10000}, "px",
           "largest radius for instances of unknown motion");
  list.add("motion.descriptor_distance", o.descriptor_distance, {1, 1e6}, "bits",
           "largest distance of a match");
  list.add("motion.descriptor_ratio", o.descriptor_ratio, {0.1, 10}, "",
           "best over second best distance");
  list.add("motion.inherit_radius", o.inherit_radius, {0, 1}, "of the width",
           "radius within which a keypoint of a frame without a prior file takes the prior of a "
           "predicted one");
  describe(list, o.belief);
  list.add("belief.memory", o.memory, {0, 1e6}, "s",
           "without a prior file after which no priors are inherited");
  list.require(o.max_matches >= o.motion.min_matches,
               "motion.max_matches must be at least motion.min_matches");
}

namespace {

constexpr double kFarDepth = 1000;            // m, of keypoints without disparity
constexpr double kDisparityTolerance = 0.25;  // of the disparity: still the same surface
constexpr double kSurelyMoving = 0.2;         // p_static
constexpr double kSurelyStatic = 3;           // log-odds
constexpr double kNoWeight = 0.3;             // p_static below which an instance supports no pose
constexpr double kFullWeight = 0.7;           // p_static above which it does in full
constexpr double kMoving = 0.5;               // p_static below which a velocity is kept

Eigen::Vector3d back_project(const StereoCamera& camera, const FrameFeatures& features,
                             std::size_t i) {
  const double depth = features.depth(i) > 0 ? features.depth(i) : kFarDepth;
  return camera.back_project(features.keypoint(i).x, features.keypoint(i).y, depth);
}

/// Of the keypoints of one instance those that are followed on: first those with a past, then
/// others at equal steps, `count` in all. A long past gives a long span and so an exact velocity;
/// equal steps spread the rest over the object.
std::vector<std::size_t> choose(const std::vector<std::size_t>& keypoints,
                                const std::vector<std::int32_t>& back, std::size_t count) {
  if (keypoints.size() <= count) return keypoints;
  std::vector<std::size_t> chosen;
  std::vector<std::size_t> others;
  for (const std::size_t i : keypoints) (back[i] >= 0 ? chosen : others).push_back(i);
  if (chosen.size() >= count) {
    std::vector<std::size_t> some;
    for (std::size_t k = 0; k < count; ++k) some.push_back(chosen[k * chosen.size() / count]);
    return some;
  }
  const std::size_t more = count - chosen.size();
  for (std::size_t k = 0; k < more; ++k) chosen.push_back(others[k * others.size() / more]);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace

InstanceTracker::InstanceTracker(const StereoCamera& camera, const ScaleLevels& scales,
                                 const InstanceTrackerOptions& options,
                                 const kys::InitialBelief& start, const kys::DistanceModel& model)
    : camera_(camera), scales_(scales), options_(options), start_(start), model_(&model) {
  check_options(options);
}

InstanceTracker::InstanceTracker(const InstanceTracker& other)
    : camera_(other.camera_),
      scales_(other.scales_),
      options_(other.options_),
      start_(other.start_),
      model_(other.model_),
      records_(other.records_),
      changed_(other.changed_),
      frames_(other.frames_),
      last_file_(other.last_file_),
      states_(other.states_) {
  for (auto& [instance, record] : records_) by_instance_[instance] = &record;
}

const InstanceTracker::InstanceRecord* InstanceTracker::find(const kys::Prior& prior) const {
  if (!follows(prior)) return nullptr;
  const auto at = by_instance_.find(prior.instance);
  return at != by_instance_.end() ? at->second : nullptr;
}

void InstanceTracker::set_log_odds(InstanceRecord& record, double log_odds) {
  record.log_odds = log_odds;
  record.p_static = probability(log_odds);
  record.belief = kys::with_belief({}, record.p_static);
}

double InstanceTracker::p_static(std::int32_t instance) const {
  const auto at = by_instance_.find(instance);
  return at != by_instance_.end() ? at->second->p_static : 1.0;
}

double InstanceTracker::log_odds(std::int32_t instance) const {
  const auto at = by_instance_.find(instance);
  return at != by_instance_.end() ? at->second->log_odds : 0.0;
}

kys::Prior InstanceTracker::with_belief(const kys::Prior& prior) const {
  const InstanceRecord* record = find(prior);
  if (record == nullptr) return prior;
  kys::Prior result = record->belief;
  result.label = prior.label;
  result.instance = prior.instance;
  result.scale = prior.scale;
  return result;
}

/// A ramp in place of a threshold: a car whose belief wavers about 0.5 would otherwise enter and
/// leave the pose from frame to frame, and pull it each time.
float InstanceTracker::weight(const kys::Prior& prior) const {
  if (!follows(prior)) return 1.0f;
  const InstanceRecord* record = find(prior);
  const double p = record != nullptr ? record->p_static : kys::p_static(prior);
  return static_cast<float>(std::clamp((p - kNoWeight) / (kFullWeight - kNoWeight), 0.0, 1.0));
}

void InstanceTracker::turn_world(const Eigen::Quaterniond& R_new_old) {
  for (auto& [instance, record] : records_) {
    if (record.velocity) *record.velocity = R_new_old * *record.velocity;
  }
}

void InstanceTracker::forget_velocities() {
  for (auto& [instance, record] : records_) record.velocity.reset();
}

std::vector<InstanceBelief> InstanceTracker::take_changed_beliefs() {
  std::vector<InstanceBelief> changed;
  changed.reserve(changed_.size());
  std::sort(changed_.begin(), changed_.end());
  for (const std::int32_t instance : changed_) {
    InstanceRecord& record = *by_instance_.at(instance);
    record.changed = false;
    const double moving_for =
        record.p_static < kSurelyMoving ? record.timestamp - record.moving_since : 0;
    changed.push_back(
        {instance, static_cast<float>(record.p_static), static_cast<float>(moving_for)});
  }
  changed_.clear();
  return changed;
}

std::vector<kys::Prior> InstanceTracker::assign_priors(double timestamp,
                                                       const FrameFeatures& features,
                                                       const Rigid3& T_c_w_expected,
                                                       const Rigid3& T_last_w) {
  std::vector<kys::Prior> priors(features.priors().begin(), features.priors().end());
  if (!priors.empty()) {
    last_file_ = timestamp;
  } else if (!frames_.empty() && timestamp - last_file_ <= options_.memory) {
    inherit(timestamp, features, T_c_w_expected * T_last_w.inverse(), T_last_w, priors);
  }
  start_beliefs(timestamp, priors);
  for (kys::Prior& prior : priors) prior = with_belief(prior);
  return priors;
}

/// Every keypoint of the last frame is moved on to where it should be seen now; a keypoint takes
/// the prior of the nearest one, if it is near and as far away: at the edge of a car the nearest
/// prediction may be on the car while the keypoint is on the wall behind it (README, "Belief").
void InstanceTracker::inherit(double timestamp, const FrameFeatures& features,
                              const Rigid3& T_now_last, const Rigid3& T_last_w,
                              std::vector<kys::Prior>& priors) {
  const Frame& last = frames_.front();
  priors.assign(features.size(), kys::Prior{});
  const auto radius = static_cast<float>(options_.inherit_radius * camera_.width);
  std::vector<float> nearest(features.size(), radius * radius);
  const Rigid3 T_now_w = T_now_last * T_last_w;
  const double dt = timestamp - last.timestamp;
  for (std::size_t i = 0; i < last.features->size(); ++i) {
    const kys::Prior& prior = last.features->prior(i);
    if (prior.label == kys::kVoidLabel) continue;
    Eigen::Vector3d p = T_now_last * back_project(camera_, *last.features, i);
    const InstanceRecord* record = find(prior);
    if (record != nullptr && record->velocity) p += T_now_w.rotation * (*record->velocity * dt);
    if (p.z() <= 0.1) continue;
    const Eigen::Vector3d pixel = camera_.project_stereo(p);
    const auto u = static_cast<float>(pixel.x());
    const auto v = static_cast<float>(pixel.y());
    const bool deep = last.features->has_stereo(i);
    const double disparity = pixel.x() - pixel.z();
    features.for_each_near(u, v, radius, 0, scales_.levels() - 1, [&](std::size_t k) {
      const Keypoint& keypoint = features.keypoint(k);
      const float du = keypoint.x - u;
      const float dv = keypoint.y - v;
      const float distance = du * du + dv * dv;
      if (distance >= nearest[k]) return;
      if (deep && features.has_stereo(k) &&
          std::abs(keypoint.x - features.u_right(k) - disparity) >
              std::max(1.0, kDisparityTolerance * disparity)) {
        return;
      }
      nearest[k] = distance;
      priors[k] = prior;
    });
  }
}

/// Instances seen for the first time start where their class and file put them; others return
/// towards that with time (README, "Belief": start, judgement, time). A flag of the file counts
/// once, as a change of the initial value, not once per frame: errors of a network
/// persist over frames.
void InstanceTracker::start_beliefs(double timestamp, std::span<const kys::Prior> priors) {
  const bool from_file = last_file_ == timestamp;
  for (const kys::Prior& prior : priors) {
    if (!follows(prior)) continue;
    InstanceRecord*& known = by_instance_[prior.instance];
    const bool is_new = known == nullptr;
    if (is_new) known = &records_[prior.instance];
    InstanceRecord& record = *known;
    if (!is_new && record.timestamp == timestamp) continue;
    const double before = is_new ? 0.0 : record.file_log_odds;
    // A file without a decision for the instance changes nothing.
    if (is_new || (from_file && prior.unjudged == 0)) record.file_log_odds = start_.log_odds(prior);
    if (is_new) {
      set_log_odds(record, record.file_log_odds);
      record.first_seen = record.moving_since = timestamp;
    } else {
      // Evidence of the images adds to the decision of the file, which may change.
      const double present = record.log_odds + record.file_log_odds - before;
      set_log_odds(record, after_time(present, record.file_log_odds, timestamp - record.timestamp,
                                      options_.belief));
    }
    if (record.p_static >= kSurelyMoving) record.moving_since = timestamp;
    record.label = prior.label;
    record.timestamp = timestamp;
    if (!std::exchange(record.changed, true)) changed_.push_back(prior.instance);
  }
}

const std::vector<InstanceState>& InstanceTracker::judge(
    double timestamp, std::shared_ptr<const FrameFeatures> features,
    std::span<const kys::Prior> segments, const Rigid3& T_c_w, std::span<const PoseTerm> terms,
    std::span<const Rigid3> past, kys::Statistics& statistics) {
  Frame now;
  now.timestamp = timestamp;
  now.features = std::move(features);
  now.back.assign(now.features->size(), -1);
  if (!terms.empty()) now.pose = PoseWithout(camera_, T_c_w, terms);
  for (std::size_t i = 0; i < now.features->size(); ++i) {
    const kys::Prior& prior = now.features->prior(i);
    if (!follows(prior)) continue;
    std::vector<std::size_t>& members = now.keypoints[prior.instance];
    if (now.features->has_stereo(i)) members.push_back(i);
  }
  for (const kys::Prior& segment : segments) {
    if (find(segment) != nullptr) now.keypoints.try_emplace(segment.instance);
  }
  states_.clear();
  if (!frames_.empty() && frames_.front().timestamp == timestamp) {
    for (const auto& [instance, members] : now.keypoints) {
      states_.push_back(state_of(instance, members));
    }
    return states_;
  }
  if (!frames_.empty()) {
    follow(now, T_c_w * past.front().inverse(), past.front(), statistics);
    transfer_beliefs(now);
  }
  for (const auto& [instance, members] : now.keypoints) {
    states_.push_back(test_motion(instance, members, now, T_c_w, past));
    update_belief(states_.back(), T_c_w);
    states_.back().p_static = p_static(instance);
  }
  frames_.push_front(std::move(now));
  if (frames_.size() > static_cast<std::size_t>(options_.max_frames)) frames_.pop_back();
  return states_;
}

/// Keypoints on instances of the last frame are searched in this one: where their velocity puts
/// them, or, if it is not known, wherever they can be. A near vehicle of unknown speed may be tens
/// of pixels away, and wheels, windows and fences repeat within that: single matches would be
/// wrong. So the shift on which most of its keypoints agree is found first (common_shift()), then
/// each is searched near it.
void InstanceTracker::follow(Frame& now, const Rigid3& T_now_last, const Rigid3& T_last_w,
                             kys::Statistics& statistics) const {
  const Frame& last = frames_.front();
  const double dt = now.timestamp - last.timestamp;
  const Rigid3 T_now_w = T_now_last * T_last_w;
  const auto max_distance = static_cast<float>(options_.descriptor_distance);
  // Only keypoints that can lie on an instance are compared.
  std::vector<std::uint8_t> taken(now.features->size(), 1);
  for (const auto& [instance, members] : now.keypoints) {
    for (const std::size_t i : members) taken[i] = 0;
  }
  const CommonShiftOptions common_options{
      .max_distance = max_distance, .min_count = options_.motion.min_matches, .taken = taken};
  std::vector<SearchQuery> queries;
  std::vector<std::size_t> sources;
  for (const auto& [instance, members] : last.keypoints) {
    if (members.empty()) continue;
    const InstanceRecord& record = records_.at(instance);
    const bool known =
        record.compared == last.timestamp && (record.velocity || record.log_odds > kSurelyStatic);
    Eigen::Vector3d shift = Eigen::Vector3d::Zero();
    if (record.velocity) shift = T_now_w.rotation * (*record.velocity * dt);
    const std::vector<std::size_t> chosen =
        choose(members, last.back, static_cast<std::size_t>(options_.max_matches));
    const auto look = [&](double farthest, std::vector<UnknownPlace>& places) {
      for (const std::size_t i : chosen) {
        const Eigen::Vector3d p = T_now_last * back_project(camera_, *last.features, i) + shift;
        if (p.z() <= 0.1) continue;
        SearchQuery query =
            query_for_feature(*last.features, i, camera_.project_stereo(p), scales_);
        const double radius =
            options_.search_radius * scales_.scale[last.features->keypoint(i).octave] +
            camera_.fx * farthest / p.z();
        query.radius = static_cast<float>(std::min(radius, options_.max_search));
        places.push_back({i, p, query});
      }
    };
    const double step = 0.5 * options_.max_acceleration * dt * dt;
    std::vector<UnknownPlace> places;
    look(known ? step : options_.max_speed * dt, places);
    if (!known) {
      const auto common = common_shift(camera_, scales_, *now.features, places, common_options,
                                       *model_, statistics);
      if (common) {
        shift += *common;
        places.clear();
        look(step, places);
      }
    }
    for (const UnknownPlace& place : places) {
      queries.push_back(place.query);
      sources.push_back(place.source);
    }
  }
  SearchOptions options;
  options.max_distance = max_distance;
  options.ratio = static_cast<float>(options_.descriptor_ratio);
  options.check_rotation = true;
  options.taken = taken;
  options.context = kys::Context::kInstance;
  const std::vector<SearchMatch> matches =
      search_features(*now.features, scales_, queries, options, *model_, statistics);
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    now.back[static_cast<std::size_t>(matches[q].feature)] = static_cast<std::int32_t>(sources[q]);
  }
}

/// An instance that appears where another has just gone is that one under a new name: it takes over
/// its belief and velocity. Segmentations rename an object that was hidden in part or divided; with
/// the initial value of its class a car known to move would support the pose again. The old name
/// must be gone and most keypoints must agree, or a car that overtakes another would get its
/// motion.
void InstanceTracker::transfer_beliefs(const Frame& now) {
  std::map<std::int32_t, std::map<std::int32_t, int>> votes;  // of each new name for old ones
  const Frame& last = frames_.front();
  for (std::size_t i = 0; i < now.back.size(); ++i) {
    if (now.back[i] < 0) continue;
    const InstanceRecord* record = find(now.features->prior(i));
    if (record == nullptr || record->first_seen != now.timestamp) continue;
    const kys::Prior& before = last.features->prior(static_cast<std::size_t>(now.back[i]));
    if (find(before) != nullptr) ++votes[now.features->prior(i).instance][before.instance];
  }
  for (const auto& [instance, names] : votes) {
    int all = 0;
    int most = 0;
    std::int32_t name = -1;
    for (const auto& [old_name, count] : names) {
      all += count;
      if (count > most) {
        most = count;
        name = old_name;
      }
    }
    InstanceRecord& record = records_.at(instance);
    const InstanceRecord& old = records_.at(name);
    // Networks change the class of what moves by itself: a van is car and bus by turns.
    const bool same_kind =
        old.label == record.label || (start_.mobility(old.label) == kys::Mobility::kMobile &&
                                      start_.mobility(record.label) == kys::Mobility::kMobile);
    if (most < options_.motion.min_matches || 2 * most < all || old.timestamp == now.timestamp ||
        !same_kind) {
      continue;
    }
    set_log_odds(record, old.log_odds);
    record.velocity = old.velocity;
    record.moving_since = old.moving_since;
  }
}

/// The state of an instance without a comparison with an earlier frame.
InstanceState InstanceTracker::state_of(std::int32_t instance,
                                        const std::vector<std::size_t>& keypoints) const {
  const InstanceRecord& record = records_.at(instance);
  InstanceState state;
  state.instance = instance;
  state.label = record.label;
  state.p_static = record.p_static;
  state.keypoints = static_cast<int>(keypoints.size());
  return state;
}

/// Compares an instance with the earliest frame in which enough of its keypoints are followed: the
/// shift of a slow object grows with the span, the noise does not. Both camera poses leave the
/// instance out: a truck that fills the view has moved the pose along, and would be found static
/// (README, "The camera without the instance").
InstanceState InstanceTracker::test_motion(std::int32_t instance,
                                           const std::vector<std::size_t>& keypoints,
                                           const Frame& now, const Rigid3& T_c_w,
                                           std::span<const Rigid3> past) const {
  InstanceState state = state_of(instance, keypoints);
  if (keypoints.empty() || frames_.empty()) return state;

  const Followed followed =
      follow_back(keypoints, now, frames_, options_.motion.min_matches, options_.kept_share);
  const std::size_t span = followed.frames;
  if (span == 0) return state;
  const Frame& before = frames_[span - 1];
  const std::vector<InstanceMatch> matches =
      matches_of(followed, *before.features, *now.features, scales_);
  const double dt = now.timestamp - before.timestamp;
  const MotionRange range{0.5 * options_.max_speed * dt, 0.5 * options_.max_turn * dt};
  const auto without = [&](const Frame& frame) {
    return frame.pose ? frame.pose->without(instance) : PoseIncrement{};
  };
  const CameraMotion ego = camera_motion(past[span - 1], without(before), T_c_w, without(now));
  state.motion = estimate_instance_motion(camera_, matches, ego, range, options_.motion);
  state.matches = state.motion.matches;
  // Where most matches fit no motion, most are wrong, and the others may be as well.
  if (state.matches < options_.motion.min_matches || 2 * state.motion.inliers < state.matches) {
    return state;
  }
  state.span = dt;
  // The next frames are compared over nearly the same span: each counts for its part of it
  // (README, "Belief": evidence).
  state.log_ratio = state.motion.log_ratio / static_cast<double>(span);
  return state;
}

void InstanceTracker::update_belief(const InstanceState& state, const Rigid3& T_c_w) {
  if (state.span <= 0) return;
  InstanceRecord& record = records_.at(state.instance);
  set_log_odds(record, after_evidence(record.log_odds, state.log_ratio, options_.belief));
  record.compared = record.timestamp;
  if (record.p_static < kMoving) {
    record.velocity = T_c_w.rotation.conjugate() * (state.motion.motion.tail<3>() / state.span);
  } else {
    record.velocity.reset();
  }
}

}  // namespace kys_slam
