// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

// The pose of a frame: predicted, then refined with the local map.

#include <kys/prior.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "matching/descriptor_matcher.h"
#include "matching/predicted_view.h"
#include "motion/belief.h"

namespace kys_slam {
namespace {

// A predicted pose is doubtful when its inlier share falls below kFallen times that of the last
// frame. A pose that needs an impossible acceleration is doubtful when the share is below
// kDoubtfulShare.
constexpr double kDoubtfulShare = 0.4;
constexpr double kFallen = 0.5;

// m/s^2, of the camera; no vehicle brakes with 10.
constexpr double kImpossible = 15;

// A doubtful pose is replaced by one that fits this share of the keyframe's matches. A pose that
// follows a moving object fits fewer.
constexpr double kExplained = 0.8;

// When the pose is doubtful by its share only, every n-th landmark of the keyframe is searched
// first.
constexpr std::size_t kSampled = 4;

// Something moves along with the camera when at least this share of the other matches fits a camera
// that has gone less than kStays of the way.
constexpr double kMovesAlong = 0.5;
constexpr double kStays = 0.5;

// The expected pose is used as a prior when the position from the observations is more uncertain
// than this share of the uncertainty of the expected position.
constexpr double kStarved = 0.5;

// A pose near the expected one may have few inliers when they are at least this share of the
// matches. It is several times the share of wrong matches that fit a pose by chance.
constexpr double kHeldShare = 0.15;

// s; impossible motions are detected for this long while frames are lost.
constexpr double kLongestCheck = 1;

// s; oldest velocity that is used at the start of a sub-map.
constexpr double kOldestVelocity = 2;

// The fixed scene is in view with this many stereo points, and supports a pose with this share of
// them. A feature within kThingEdge px of its octave of a thing's feature may show the thing's
// edge, and supports nothing. For kUnsupported seconds after its support a pose may rest on things
// alone.
constexpr std::size_t kFixedInView = 30;
constexpr double kFixedShare = 0.08;
constexpr float kThingEdge = 6;
constexpr double kUnsupported = 0.5;

// nats; the belief about a thing comes from earlier poses, which may have been wrong.
constexpr double kMaxVote = 3;

/// Gives matched features their landmarks; returns how many.
int assign(const std::vector<SearchMatch>& matches, const std::vector<LandmarkId>& wanted,
           std::vector<LandmarkId>& landmarks) {
  int count = 0;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    landmarks[static_cast<std::size_t>(matches[q].feature)] = wanted[q];
    ++count;
  }
  return count;
}

/// The prior of the frame; that of the landmark when the frame has none.
const kys::Prior& prior_of_match(const kys::Prior& keypoint, const kys::Prior& landmark) {
  return keypoint.label != kys::kVoidLabel ? keypoint : landmark;
}

/// Between two camera centres, m.
double distance(const Rigid3& T_a_w, const Rigid3& T_b_w) {
  return (T_a_w.inverse_t() - T_b_w.inverse_t()).norm();
}

}  // namespace

bool Tracker::predict(Frame& frame, TrackResult& result) {
  const bool expects = expected_pose(frame.taken).has_value();
  if (!expects || !predict_by_motion(frame, result)) {
    if (predict_by_reference(frame, result) && is_possible(frame, result)) return true;
    return expects && options_.acceleration > 0 && predict_by_points(frame, result);
  }
  result.jumped = impossible_;
  if (impossible_ && replace_jump(frame, result)) return true;
  if (doubtful_) replace_misfit(frame, result);
  if (impossible_) result.reason += "; impossible motion";
  return true;
}

/// After a sudden reversal the camera is far from the expected pose, and the matches found there
/// fit by chance. A search without a prediction then fits nearly all of the keyframe, or leads to a
/// pose that is far away as well.
void Tracker::replace_misfit(Frame& frame, TrackResult& result) {
  Frame unexpected = frame;
  TrackResult alternative;
  const auto fits = [&](std::size_t every) {
    alternative.reason = "doubtful motion model";
    const bool found = predict_by_reference(unexpected, alternative, every);
    return found ? unexpected.landmark_count() / static_cast<double>(alternative.matches) : 0.0;
  };
  bool asked = impossible_;
  if (!asked) {
    const double sampled = fits(kSampled);
    asked = sampled >= kExplained || (sampled >= kDoubtfulShare && is_jump(unexpected));
  }
  const double share = asked ? fits(1) : 0;
  if (share >= kExplained && unexpected.landmark_count() > frame.landmark_count()) {
    replace(frame, result, std::move(unexpected), alternative);
  } else if (!impossible_ && share >= kDoubtfulShare && is_jump(unexpected)) {
    replace_jump(frame, result, kDoubtfulShare);
  }
  result.statistics += alternative.statistics;
}

/// For a pose that needs an impossible acceleration: it may follow a thing that moves along with
/// the camera, which a search near the prediction prefers. The whole local map is searched without
/// a prediction. Its pose is used when it fits at least `least_share` of the matches.
bool Tracker::replace_jump(Frame& frame, TrackResult& result, double least_share) {
  Frame unexpected = frame;
  TrackResult alternative;
  alternative.reason = "impossible motion";
  const bool found = predict_by_map(unexpected, alternative);
  result.statistics += alternative.statistics;
  const int fits = unexpected.landmark_count();
  if (!found || fits < options_.min_local_inliers || fits < least_share * alternative.matches) {
    return false;
  }
  replace(frame, result, std::move(unexpected), alternative);
  result.jumped = true;
  return true;
}

/// Replaces the prediction by another one.
void Tracker::replace(Frame& frame, TrackResult& result, Frame other, const TrackResult& found) {
  share_ = other.landmark_count() / static_cast<double>(found.matches);
  frame = std::move(other);
  result.reason = found.reason;
  result.overruled = found.overruled;
}

/// Pose of a picture taken at a time (s) by constant velocity since the last frame with a pose;
/// none when that frame is more than `longest` s earlier.
std::optional<ExpectedPose> Tracker::expected_pose(double taken, double longest) const {
  if (!velocity_ || !last_) return std::nullopt;
  const double interval = taken - last_->taken;
  if (interval > std::max(longest, 1.5 * velocity_->interval)) return std::nullopt;
  const double age = last_->taken - velocity_->taken;
  if (age > kOldestVelocity) return std::nullopt;
  const double before = velocity_->interval;
  if (interval <= 0) return ExpectedPose{last_->T_c_w, before * (before + age)};
  const Rigid3& step = velocity_->T_c_last;
  const double times = clock_.ratio(interval, before);
  if (times == 1) return ExpectedPose{step * last_->T_c_w, interval * (interval + age)};
  if (options_.acceleration <= 0) return std::nullopt;
  // The velocity is that of the middle of the step before.
  const double reach = interval * ((interval + before) / 2 + age);
  const Rigid3 other(so3_exp(times * so3_log(step.rotation)), times * step.translation);
  return ExpectedPose{other * last_->T_c_w, reach};
}

/// Searches the landmarks of the last frame where constant velocity predicts them.
bool Tracker::predict_by_motion(Frame& frame, TrackResult& result) {
  const ExpectedPose expected = *expected_pose(frame.taken);
  // Pictures may be missing between two frames.
  const double interval = frame.taken - last_->taken;
  const double steps =
      clock_.steps_in(interval).value_or(std::round(interval / velocity_->interval));
  const auto since =
      static_cast<float>(std::max(static_cast<double>(frame.index - last_->index), steps));
  const float radius = options_.motion_radius * std::min(since, kMostSteps);
  frame.T_c_w = expected.T_c_w;
  int matches = match_last_frame(frame, radius, result);
  if (matches < options_.min_motion_matches) {
    matches = match_last_frame(frame, 2 * radius, result);
  }
  if (matches < options_.min_motion_matches) {
    result.reason = "motion model: " + std::to_string(matches) + " matches";
    return false;
  }
  const std::vector<LandmarkId> matched = frame.landmarks;
  const int inliers = refine_pose(frame, result);
  const double before = std::exchange(share_, inliers / static_cast<double>(matches));
  impossible_ = is_jump(frame);
  doubtful_ = impossible_ ? share_ < kDoubtfulShare
                          : share_ < kFallen * before && !others_move_along(frame, matched);
  result.reason = "motion model";
  if (inliers >= options_.min_pose_inliers) return true;
  result.reason += ": " + std::to_string(inliers) + " inliers";
  return false;
}

/// Whether most of the `matched` landmarks (per feature) that the frame has lost are on something
/// that moves along with the camera: a camera that hardly moves fits them.
bool Tracker::others_move_along(const Frame& frame, const std::vector<LandmarkId>& matched) const {
  std::vector<PoseObservation> others;
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (!matched[i].valid() || frame.landmarks[i].valid()) continue;
    others.push_back(observation(frame, i, replica_.landmarks().at(matched[i])));
  }
  const PoseResult pose = optimize_pose(camera_, last_->T_c_w, others);
  return pose.inliers >= kMovesAlong * static_cast<double>(others.size()) &&
         distance(pose.T_c_w, last_->T_c_w) < kStays * distance(frame.T_c_w, last_->T_c_w);
}

int Tracker::match_last_frame(Frame& frame, float radius, TrackResult& result) {
  const Rigid3 T_c_last = frame.T_c_w * last_->T_c_w.inverse();
  const double forward = -(T_c_last.rotation.conjugate() * T_c_last.translation).z();
  const bool moving = std::abs(forward) > camera_.baseline;

  std::deque<kys::Prior> priors;
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> landmarks;
  for (std::size_t i = 0; i < last_->landmarks.size(); ++i) {
    const LandmarkId id = last_->landmarks[i];
    if (!id.valid()) continue;
    const LandmarkView& landmark = replica_.landmarks().at(id);
    const Eigen::Vector3d p_c = frame.T_c_w * landmark.p_w;
    if (p_c.z() <= 0) continue;
    const Eigen::Vector3d pixel = camera_.project_stereo(p_c);
    if (!camera_.in_image(pixel.x(), pixel.y())) continue;
    const Keypoint& seen = last_->features->keypoint(i);
    SearchQuery query;
    query.u = static_cast<float>(pixel.x());
    query.v = static_cast<float>(pixel.y());
    query.u_right = static_cast<float>(pixel.z());
    query.radius = radius * scales_.scale[seen.octave];
    // Things appear larger when the camera approaches them.
    query.min_octave = moving && forward < 0 ? 0 : seen.octave - (moving ? 0 : 1);
    query.max_octave =
        moving && forward > 0 ? scales_.levels() - 1 : seen.octave + (moving ? 0 : 1);
    query.angle = seen.angle;
    query.descriptor = &landmark.descriptor;
    query.prior = prior_of(landmark, priors);
    queries.push_back(query);
    landmarks.push_back(id);
  }
  SearchOptions options;
  options.max_distance = options_.max_distance;
  options.check_rotation = true;
  const std::vector<SearchMatch> matches =
      search_features(*frame.features, scales_, queries, options, *model_, result.statistics);
  std::fill(frame.landmarks.begin(), frame.landmarks.end(), LandmarkId{});
  return assign(matches, landmarks, frame.landmarks);
}

/// No velocity, or it was wrong: the reference keyframe's landmarks by descriptor alone, starting
/// from the last pose. With `every` n, every n-th of the landmarks, without the prior of the
/// expected pose: with so few matches that prior would decide the pose.
bool Tracker::predict_by_reference(Frame& frame, TrackResult& result, std::size_t every) {
  const KeyFrameView& reference = replica_.keyframes().at(reference_);
  std::vector<DescriptorQuery> queries;
  std::vector<LandmarkId> landmarks;
  // Class and instance are those of the keyframe's feature, like its descriptor; motion is that of
  // the latest observation.
  std::vector<kys::Prior> priors(reference.landmarks.size());
  std::size_t known = 0;
  for (std::size_t i = 0; i < reference.landmarks.size(); ++i) {
    const LandmarkView* landmark = replica_.landmarks().find(reference.landmarks[i]);
    if (landmark == nullptr || known++ % every != 0) continue;
    priors[i] = with_belief(kys::landmark_prior(reference.features->prior(i), landmark->prior));
    queries.push_back(
        {&reference.features->descriptor(i), &priors[i], reference.features->keypoint(i).angle});
    landmarks.push_back(reference.landmarks[i]);
  }
  return predict_by_descriptor(frame, {queries, landmarks, "reference keyframe", true, every == 1},
                               result);
}

/// The same with all landmarks of the map around the last frame.
bool Tracker::predict_by_map(Frame& frame, TrackResult& result) {
  const LocalMap local = local_map_gatherer_.gather(replica_, last_->landmarks);
  std::vector<DescriptorQuery> queries;
  std::deque<kys::Prior> priors;
  for (const LandmarkId id : local.landmarks) {
    const LandmarkView& landmark = replica_.landmarks().at(id);
    queries.push_back({&landmark.descriptor, prior_of(landmark, priors)});
  }
  return predict_by_descriptor(frame, {queries, local.landmarks, "local map"}, result);
}

bool Tracker::predict_by_descriptor(Frame& frame, const Unpredicted& asked, TrackResult& result) {
  std::fill(frame.landmarks.begin(), frame.landmarks.end(), LandmarkId{});
  const DescriptorMatchOptions options{options_.reference_distance, options_.reference_ratio,
                                       asked.angles};
  const std::vector<std::int32_t> matches =
      match_descriptors(asked.queries, *frame.features, options, *model_, result.statistics);
  int count = 0;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q] < 0) continue;
    frame.landmarks[static_cast<std::size_t>(matches[q])] = asked.landmarks[q];
    ++count;
  }
  const std::string before = (result.reason.empty() ? "" : result.reason + "; ") + asked.name;
  if (count < options_.min_reference_matches) {
    result.reason = before + ": " + std::to_string(count) + " matches";
    return false;
  }
  result.matches = count;
  frame.T_c_w = last_->T_c_w;
  result.overruled = false;
  const int inliers = refine_pose(frame, result, asked.expects);
  result.reason = before;
  if (inliers >= options_.min_pose_inliers) return true;
  result.reason += ": " + std::to_string(inliers) + " inliers";
  return false;
}

/// A feature as an observation of a landmark; includes the noise of the landmark's position.
StereoPixel Tracker::pixel_of(const Frame& frame, std::size_t feature,
                              const LandmarkView& landmark) const {
  return pixel_of(frame, feature, landmark.observers.size());
}

StereoPixel Tracker::pixel_of(const Frame& frame, std::size_t feature,
                              std::size_t observations) const {
  StereoPixel pixel = frame.features->stereo_pixel(feature, scales_);
  const double count = std::max<double>(1, static_cast<double>(observations));
  const double noise = options_.landmark_noise / count;
  pixel.inv_sigma /= static_cast<float>(std::sqrt(1 + noise));
  return pixel;
}

PoseObservation Tracker::observation(const Frame& frame, std::size_t feature,
                                     const LandmarkView& landmark) const {
  return observation(frame, feature, landmark.p_w, landmark.observers.size());
}

/// Of a point with that many observations.
PoseObservation Tracker::observation(const Frame& frame, std::size_t feature,
                                     const Eigen::Vector3d& p_w, std::size_t observations) const {
  const StereoPixel pixel = pixel_of(frame, feature, observations);
  return {p_w, pixel.u, pixel.v, pixel.u_right, pixel.inv_sigma, 1, pixel.ratio};
}

/// Pose from the frame's landmarks; outliers lose their landmark. Returns the number of inliers.
/// Without `expects` the expected pose is not used.
int Tracker::refine_pose(Frame& frame, TrackResult& result, bool expects) const {
  frame.held.reset();
  std::vector<PoseObservation> observations;
  std::vector<Vote> votes;
  std::vector<std::size_t> features;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (!frame.landmarks[i].valid()) continue;
    const LandmarkView& landmark = replica_.landmarks().at(frame.landmarks[i]);
    observations.push_back(observation(frame, i, landmark));
    observations.back().share = std::min(belief(landmark.prior), belief(frame.features->prior(i)));
    if (options_.consensus.by_class)
      votes.push_back(vote(frame.features->prior(i), landmark.prior));
    features.push_back(i);
  }
  const std::optional<ExpectedPose> expected = expects ? expected_pose(frame.taken) : std::nullopt;
  const Start start = result.overruled ? Start::kConsensus : Start::kGuess;
  const auto estimate = [&](const Rigid3& T_c_w, const PoseOptions& pose) {
    return estimate_pose(camera_, T_c_w, observations, votes, expected, options_.consensus, start,
                         pose);
  };
  ConsensusResult consensus = estimate(frame.T_c_w, {});
  if (expected && options_.acceleration > 0) {
    const double reach = expected->reach;
    const PosePrior prior{expected->T_c_w, options_.acceleration * reach,
                          options_.turn_acceleration * reach};
    // After a sudden reversal the camera is not at the expected pose; predict() detects that.
    const double away = distance(consensus.pose.T_c_w, expected->T_c_w);
    const bool doubtful =
        consensus.pose.inliers < kDoubtfulShare * static_cast<double>(observations.size()) &&
        away > options_.consensus.max_acceleration * reach;
    if (!doubtful && position_sigma(consensus.pose) > kStarved * prior.sigma_position) {
      PoseOptions held;
      held.prior = prior;
      consensus = estimate(expected->T_c_w, held);
      frame.held = prior;
    }
  }
  frame.T_c_w = consensus.pose.T_c_w;
  result.overruled |= consensus.overruled;
  for (std::size_t k = 0; k < features.size(); ++k) {
    if (consensus.pose.outlier[k] != 0) frame.landmarks[features[k]] = {};
  }
  return consensus.pose.inliers;
}

/// Whether the frame's pose is possible after the last motion.
bool Tracker::is_expected(const Frame& frame) const {
  const std::optional<ExpectedPose> expected = expected_pose(frame.taken);
  if (!expected || options_.acceleration <= 0) return false;
  const double away = distance(frame.T_c_w, expected->T_c_w);
  return away <= options_.consensus.max_acceleration * expected->reach;
}

/// Whether a pose found without the prediction is possible. When a moving object fills the image,
/// all matches may be on it. Then the frame has no pose, for as long as the motion model is used. A
/// time stamp may be wrong by up to one frame, so the step may be twice as long as expected.
bool Tracker::is_possible(const Frame& frame, TrackResult& result) const {
  if (options_.acceleration <= 0 || !is_jump(frame, 1)) return true;
  result.jumped = true;
  result.reason += "; impossible motion";
  return false;
}

/// Whether the frame's pose is impossible after the last motion, with a tolerance of `steps` times
/// the last step.
bool Tracker::is_jump(const Frame& frame, double steps) const {
  const std::optional<ExpectedPose> expected = expected_pose(frame.taken, kLongestCheck);
  if (!expected) return false;
  const double away = distance(frame.T_c_w, expected->T_c_w);
  return away > kImpossible * expected->reach + steps * velocity_->T_c_last.inverse_t().norm();
}

/// Instance of a match on a thing that can move, and the log-odds that it is static.
Vote Tracker::vote(const kys::Prior& keypoint, const kys::Prior& landmark) const {
  const kys::Prior& prior = prior_of_match(keypoint, landmark);
  if (!has_belief(prior, start_)) return {};
  const double odds = instances_ ? instances_->log_odds(prior.instance) : start_.log_odds(prior);
  return {prior.instance, static_cast<float>(std::clamp(odds, -kMaxVote, kMaxVote))};
}

/// With beliefs: whether what cannot move supports the pose, or did so a short time ago, or is not
/// in view. Otherwise things that move together may carry the pose along. Parked ones may hold it
/// for a short time, while new parts of the scene come into view.
bool Tracker::is_supported(const Frame& frame) {
  if (!instances_) return true;
  const FrameFeatures& features = *frame.features;
  std::vector<std::uint8_t> on_thing(features.size(), 0);
  std::vector<std::size_t> fixed;  // inliers
  std::size_t in_view = 0;         // of the fixed scene
  std::size_t held = 0;            // inliers on things
  for (std::size_t i = 0; i < features.size(); ++i) {
    const kys::Prior& prior = features.prior(i);
    const LandmarkView* landmark = replica_.landmarks().find(frame.landmarks[i]);
    if (has_belief(landmark != nullptr ? prior_of_match(prior, landmark->prior) : prior, start_)) {
      on_thing[i] = 1;
      if (landmark != nullptr) ++held;
    } else if (landmark != nullptr || features.has_stereo(i)) {
      ++in_view;
      if (landmark != nullptr) fixed.push_back(i);
    }
  }
  if (in_view < kFixedInView) {
    if (supported_) supported_ = frame.taken;
    return true;
  }
  const auto is_edge = [&](const Keypoint& k) {
    const float reach = kThingEdge * scales_.scale[k.octave];
    bool edge = false;
    features.for_each_near(k.x, k.y, reach, 0, scales_.levels() - 1, [&](std::size_t i) {
      const float dx = features.keypoint(i).x - k.x, dy = features.keypoint(i).y - k.y;
      edge |= on_thing[i] != 0 && dx * dx + dy * dy < reach * reach;
    });
    return edge;
  };
  const auto support = std::count_if(fixed.begin(), fixed.end(),
                                     [&](std::size_t i) { return !is_edge(features.keypoint(i)); });
  const double needed =
      std::min(static_cast<double>(held), kFixedShare * static_cast<double>(in_view));
  if (static_cast<double>(support) >= needed) supported_ = frame.taken;
  return supported_ && frame.taken - *supported_ <= kUnsupported;
}

/// A landmark's prior with the present belief; valid as long as `kept` exists.
const kys::Prior* Tracker::prior_of(const LandmarkView& landmark,
                                    std::deque<kys::Prior>& kept) const {
  if (!instances_) return &landmark.prior;
  return &kept.emplace_back(instances_->with_belief(landmark.prior));
}

bool Tracker::track_local_map(Frame& frame, TrackResult& result) {
  // Without landmarks the pose comes from other points of the last frame.
  const bool by_points = frame.landmark_count() == 0 && last_;
  const LocalMap local =
      local_map_gatherer_.gather(replica_, by_points ? last_->landmarks : frame.landmarks);
  if (local.reference.valid()) reference_ = local.reference;
  const std::vector<LandmarkId> predicted = frame.landmarks;
  match_local_landmarks(frame, local, result);
  result.matches = frame.landmark_count();
  if (frame.left != nullptr) {
    frame.features =
        patches_.align(replica_, frame.T_c_w, frame.landmarks, *frame.left, *frame.features);
  }
  const std::vector<LandmarkId> matched = frame.landmarks;
  result.inliers = refine_pose(frame, result);
  for (const LandmarkId id : predicted) {
    if (id.valid()) counts_.add_visible(id);
  }
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (frame.landmarks[i].valid()) counts_.add_found(frame.landmarks[i]);
  }
  const bool sure = is_expected(frame) && result.inliers >= kHeldShare * result.matches;
  const int wanted = sure ? options_.min_held_inliers : options_.min_local_inliers;
  if (result.inliers < wanted) {
    result.reason += "; local map: " + std::to_string(result.inliers) + " inliers";
    return false;
  }
  if (is_supported(frame)) return true;
  result.reason += "; local map: only things that can move support the pose";
  return false;
}

/// Landmarks of the local map that should be in view and are not matched yet.
void Tracker::match_local_landmarks(Frame& frame, const LocalMap& local, TrackResult& result) {
  std::vector<std::uint8_t> taken(frame.landmarks.size(), 0);
  std::vector<LandmarkId> held;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (!frame.landmarks[i].valid()) continue;
    taken[i] = 1;
    held.push_back(frame.landmarks[i]);
  }
  std::sort(held.begin(), held.end());
  const Eigen::Vector3d centre = frame.T_c_w.inverse_t();
  std::deque<kys::Prior> priors;
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> landmarks;
  replica_.landmarks().visit(local.landmarks, [&](LandmarkId id, const LandmarkView& landmark) {
    const auto view = predict_view(camera_, scales_, frame.T_c_w, centre, landmark);
    if (!view || std::binary_search(held.begin(), held.end(), id)) return;
    // The prediction is better when the angle between the two views is small.
    const float radius = (view->cosine > 0.998f ? 2.5f : 4.0f) * options_.local_radius;
    queries.push_back(
        query_for(*view, radius, scales_, landmark.descriptor, *prior_of(landmark, priors)));
    landmarks.push_back(id);
    counts_.add_visible(id);
  });
  SearchOptions options;
  options.max_distance = options_.max_distance;
  options.ratio = options_.local_ratio;
  options.taken = taken;
  const std::vector<SearchMatch> matches =
      search_features(*frame.features, scales_, queries, options, *model_, result.statistics);
  assign(matches, landmarks, frame.landmarks);
}

}  // namespace kys_slam
