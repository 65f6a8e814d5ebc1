#include "tracking/tracker.h"

#include <kys/prior.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "matching/descriptor_matcher.h"
#include "matching/predicted_view.h"

namespace kys_slam {

void describe(kys::OptionList& list, TrackerOptions& o) {
  list.add("tracking.min_start_points", o.min_start_points, {10, 60000}, "",
           "stereo points to start a map");
  list.add("tracking.close_baselines", o.close_baselines, {1, 1e6}, "baselines",
           "points nearer than this are close: stereo alone gives an accurate position");
  list.add("tracking.motion_radius", o.motion_radius, {0.5, 1000}, "px",
           "search radius around a prediction by constant velocity, octave 0");
  list.add("tracking.min_motion_matches", o.min_motion_matches, {3, 60000}, "",
           "matches below which the radius is doubled, then the prediction is dropped");
  list.add("tracking.min_reference_matches", o.min_reference_matches, {3, 60000}, "",
           "matches with the reference keyframe below which a frame is lost");
  list.add("tracking.min_pose_inliers", o.min_pose_inliers, {3, 60000}, "",
           "inliers of a predicted pose below which it is dropped");
  list.add("tracking.min_local_inliers", o.min_local_inliers, {3, 60000}, "",
           "inliers with the local map below which a frame is lost");
  list.add("tracking.min_held_inliers", o.min_held_inliers, {3, 60000}, "",
           "the same for a pose predicted by constant velocity (tracking.acceleration > 0)");
  list.add("tracking.local_radius", o.local_radius, {0.1, 100}, "",
           "factor on the search radius of local landmarks (2.5 or 4 px, octave 0)");
  list.add("tracking.local_ratio", o.local_ratio, {0.1, 10}, "", "best over second best distance");
  list.add("tracking.max_distance", o.max_distance, {1, 1e6}, "bits",
           "largest distance of a match");
  list.add("tracking.reference_distance", o.reference_distance, {1, 1e6}, "bits",
           "largest distance of a match without prediction");
  list.add("tracking.reference_ratio", o.reference_ratio, {0.1, 10}, "",
           "best over second best distance without prediction");
  list.add("tracking.align", o.align,
           "keypoints are aligned with the image patches of their landmarks");
  list.add("tracking.acceleration", o.acceleration, {0, 1e6}, "m/s^2",
           "standard deviation about constant velocity, a prior of poses with few matches and of "
           "lost frames; 0: no prior");
  list.add("tracking.turn_acceleration", o.turn_acceleration, {1e-3, 1e6}, "rad/s^2",
           "the same for rotation");
  describe(list, o.consensus);
  describe(list, o.keyframes);
  describe(list, o.instances);
}

namespace {

// A predicted pose is doubted when the share that it fits of the matches that led to it has fallen
// below the part kFallen of the last frame's, and one that no camera can have come to when it is
// below kDoubtfulShare.
constexpr double kDoubtfulShare = 0.4;
constexpr double kFallen = 0.5;

// m/s^2, of the camera; no vehicle brakes with 10.
constexpr double kImpossible = 15;

// It gives way to one that fits this share of the keyframe's matches: with what moves in front of
// the camera a pose fits many, but not all.
constexpr double kExplained = 0.8;

// Where the share alone raises doubt, the keyframe is asked by every n-th of its landmarks first.
constexpr std::size_t kSampled = 4;

// Something moves along with the camera when at least this share of the other matches fits a camera
// that has gone less than kStays of the way.
constexpr double kMovesAlong = 0.5;
constexpr double kStays = 0.5;

// The expected pose joins the observations where they leave the camera's place this much of the
// uncertainty that it has without them.
constexpr double kStarved = 0.5;

// s; the motion model goes on so long where frames are lost.
constexpr double kLongestGuess = 0.5;

// s; a velocity as old as that still helps where a sub-map starts.
constexpr double kOldestVelocity = 2;

// nats; what is believed of a thing was judged by earlier poses, which may have been wrong.
constexpr double kMaxVote = 3;

// A camera that gives a picture more often than that stands still.
constexpr int kMostRepeats = 3;

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

/// Between two camera centres, m.
double distance(const Rigid3& T_a_w, const Rigid3& T_b_w) {
  return (T_a_w.inverse_t() - T_b_w.inverse_t()).norm();
}

int count_stereo(const FrameFeatures& features) {
  int stereo = 0;
  for (std::size_t i = 0; i < features.size(); ++i) stereo += features.has_stereo(i) ? 1 : 0;
  return stereo;
}

int count_landmarks(const std::vector<LandmarkId>& landmarks) {
  return static_cast<int>(
      std::count_if(landmarks.begin(), landmarks.end(), [](LandmarkId id) { return id.valid(); }));
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
      patches_(camera, scales) {
  check_options(options);
  if (model.uses_belief()) {
    instances_.emplace(camera, scales, options.instances, start, model);
  }
}

Tracker::Frame Tracker::make_frame(const TrackerInput& input) {
  std::shared_ptr<const FrameFeatures> features = input.features;
  if (instances_) {
    const Rigid3 T_last_w = last_ ? last_->T_c_w : Rigid3{};
    const std::optional<ExpectedPose> motion = expected_pose(input.timestamp);
    const Rigid3 expected = motion ? motion->T_c_w : T_last_w;
    std::vector<kys::Prior> priors =
        instances_->assign_priors(input.timestamp, *features, expected, T_last_w);
    features = std::make_shared<const FrameFeatures>(features->with_priors(std::move(priors)));
  }
  Frame frame{input.index,
              input.timestamp,
              std::move(features),
              {},
              {},
              {},
              options_.align ? input.left : nullptr,
              input.segments};
  frame.landmarks.resize(frame.features->size());
  return frame;
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
  Frame frame = make_frame(input);
  const std::optional<Velocity> moving = velocity_;
  const bool repeated = last_ && input.repeated && last_->index + 1 == input.index;
  repeats_ = repeated ? repeats_ + 1 : 0;
  if (repeated && velocity_) velocity_->T_c_last = Rigid3();
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
  // The next picture shows what the camera did during repeated ones.
  if (repeated && repeats_ <= kMostRepeats) velocity_ = moving;
  return result;
}

/// A frame with a pose: perhaps a keyframe, and what the next one starts from. False where the pose
/// rests on things that turn out to move.
bool Tracker::finish_tracked(Frame frame, int waiting, TrackResult& result) {
  Stopwatch watch;
  if (result.overruled) result.reason += "; image area against most matches";
  if (result.held) result.reason += "; held by constant velocity";
  if (instances_) judge_instances(frame, result);
  if (result.inliers < std::min(options_.min_held_inliers, options_.min_local_inliers)) {
    result.reason += "; " + std::to_string(result.inliers) + " inliers stand still";
    forget_instance_frames();
    return false;
  }
  result.status = TrackingStatus::kTracked;
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
  Frame frame = make_frame(input);
  frame.T_c_w = place.T_c_w;
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
    if (submap(reference_) != submap(before)) first_keyframe_ = reference_;
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
  return !frozen_ && count_stereo(features) >= options_.min_start_points;
}

TrackResult Tracker::start_submap(const TrackerInput& input) {
  TrackResult result;
  Frame frame = make_frame(input);
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
  if (instances_) judge_instances(frame, result);
  result.keyframe = make_keyframe(frame);
  first_keyframe_ = result.keyframe->id;
  result.inliers = result.matches = static_cast<int>(result.keyframe->new_landmarks.size());
  keep_as_last(std::move(frame), result);
}

/// What the next frame starts from.
void Tracker::keep_as_last(Frame frame, TrackResult& result) {
  const Replica::Anchor anchor = replica_.resolve(reference_);
  frame.pose.reference = anchor.keyframe;
  frame.pose.T_c_reference = frame.T_c_w * replica_.keyframes().at(anchor.keyframe).T_c_w.inverse();
  result.pose = frame.pose;
  result.T_c_w = frame.T_c_w;
  // The pose before a relocalisation may be wrong, or of another sub-map.
  if (last_ && last_->index + 1 == frame.index && result.status == TrackingStatus::kTracked &&
      !result.relocalised) {
    velocity_ = {frame.T_c_w * last_->T_c_w.inverse(), frame.timestamp - last_->timestamp,
                 frame.timestamp};
  } else if (result.status != TrackingStatus::kStarted || options_.acceleration <= 0) {
    velocity_.reset();
  }
  if (instances_) {
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
    terms.push_back({landmark->p_w, frame.features->stereo_pixel(i, scales_),
                     std::min(belief(prior), belief(landmark->prior)),
                     instances_->follows(prior) ? prior.instance : -1});
  }
  std::vector<Rigid3> past;
  for (const FramePose& pose : judged_) past.push_back(current_pose(pose));
  result.instances = instances_->judge(frame.timestamp, frame.features, frame.segments, frame.T_c_w,
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

/// A landmark's prior with belief as it is now; kept for as long as `kept` lives.
const kys::Prior* Tracker::prior_of(const LandmarkView& landmark,
                                    std::deque<kys::Prior>& kept) const {
  if (!instances_) return &landmark.prior;
  return &kept.emplace_back(instances_->with_belief(landmark.prior));
}

/// The map may have moved since the last frame: its pose follows its keyframe, its landmarks their
/// successors.
void Tracker::refresh_last_frame() {
  const Replica::Anchor anchor = replica_.resolve(last_->pose.reference);
  // The culled keyframe's own frame lies between: T_c_ref_old * T_ref_old_ref_new.
  last_->pose = {anchor.keyframe, last_->pose.T_c_reference * anchor.T_c_k};
  last_->T_c_w = last_->pose.T_c_reference * replica_.keyframes().at(anchor.keyframe).T_c_w;
  for (LandmarkId& id : last_->landmarks) {
    if (id.valid()) id = replica_.resolve(id);
  }
  reference_ = replica_.resolve(reference_).keyframe;
}

Rigid3 Tracker::current_pose(const FramePose& pose) const {
  const Replica::Anchor anchor = replica_.resolve(pose.reference);
  return pose.T_c_reference * anchor.T_c_k * replica_.keyframes().at(anchor.keyframe).T_c_w;
}

KeyFrameId Tracker::submap(KeyFrameId keyframe) const {
  const KeyFrameView* view = replica_.keyframes().find(replica_.resolve(keyframe).keyframe);
  return view != nullptr ? view->submap : KeyFrameId{};
}

bool Tracker::predict(Frame& frame, TrackResult& result) {
  if (!expected_pose(frame.timestamp) || !predict_by_motion(frame, result)) {
    return predict_by_reference(frame, result);
  }
  result.jumped = impossible_;
  if (impossible_ && replace_jump(frame, result)) return true;
  if (doubtful_) replace_misfit(frame, result);
  if (impossible_) result.reason += "; impossible motion";
  return true;
}

/// A camera that turns back at once is far from where it was expected: what is found there fits by
/// chance. Without a prediction nearly all of the keyframe fits, or what does is far away as well.
void Tracker::replace_misfit(Frame& frame, TrackResult& result) {
  Frame unexpected = frame;
  TrackResult alternative;
  const auto fits = [&](std::size_t every) {
    alternative.reason = "doubtful motion model";
    const bool found = predict_by_reference(unexpected, alternative, every);
    return found ? count_landmarks(unexpected.landmarks) / static_cast<double>(alternative.matches)
                 : 0.0;
  };
  bool asked = impossible_;
  if (!asked) {
    const double sampled = fits(kSampled);
    asked = sampled >= kExplained || (sampled >= kDoubtfulShare && is_jump(unexpected));
  }
  const double share = asked ? fits(1) : 0;
  if (share >= kExplained &&
      count_landmarks(unexpected.landmarks) > count_landmarks(frame.landmarks)) {
    replace(frame, result, std::move(unexpected), alternative);
  } else if (!impossible_ && share >= kDoubtfulShare && is_jump(unexpected)) {
    replace_jump(frame, result, kDoubtfulShare);
  }
  result.statistics += alternative.statistics;
}

/// No camera can have come to the pose found: it may be that of a thing that moves along with the
/// camera, which a search near the prediction favours. The whole local map, searched without a
/// prediction, decides where it fits at least this share of its matches.
bool Tracker::replace_jump(Frame& frame, TrackResult& result, double least_share) {
  Frame unexpected = frame;
  TrackResult alternative;
  alternative.reason = "impossible motion";
  const bool found = predict_by_map(unexpected, alternative);
  result.statistics += alternative.statistics;
  const int fits = count_landmarks(unexpected.landmarks);
  if (!found || fits < options_.min_local_inliers || fits < least_share * alternative.matches) {
    return false;
  }
  replace(frame, result, std::move(unexpected), alternative);
  result.jumped = true;
  return true;
}

/// What was predicted otherwise takes the place of the prediction.
void Tracker::replace(Frame& frame, TrackResult& result, Frame other, const TrackResult& found) {
  share_ = count_landmarks(other.landmarks) / static_cast<double>(found.matches);
  frame = std::move(other);
  result.reason = found.reason;
  result.overruled = found.overruled;
}

/// Constant velocity since the last frame with a pose, for as long as that means something.
std::optional<ExpectedPose> Tracker::expected_pose(double timestamp) const {
  if (!velocity_ || !last_) return std::nullopt;
  const double interval = timestamp - last_->timestamp;
  if (interval > std::max(kLongestGuess, 1.5 * velocity_->interval)) return std::nullopt;
  const double times = interval / velocity_->interval;
  const double age = last_->timestamp - velocity_->timestamp;
  if (age > kOldestVelocity) return std::nullopt;
  const double reach = interval * (interval + age);
  // Time stamps jitter more than vehicles do: only missing frames make a longer step.
  if (times < 1.5) return ExpectedPose{velocity_->T_c_last * last_->T_c_w, reach};
  if (options_.acceleration <= 0) return std::nullopt;
  const Rigid3& step = velocity_->T_c_last;
  const Rigid3 longer(so3_exp(times * so3_log(step.rotation)), times * step.translation);
  return ExpectedPose{longer * last_->T_c_w, reach};
}

/// Constant velocity, and the last frame's landmarks searched where it puts them.
bool Tracker::predict_by_motion(Frame& frame, TrackResult& result) {
  const ExpectedPose expected = *expected_pose(frame.timestamp);
  const auto since = static_cast<float>(frame.index - last_->index);
  const float radius = options_.motion_radius * std::min(since, 3.0f);
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
    // Things grow when one drives towards them.
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
/// from the last pose. With `every` n, every n-th of the landmarks, whatever pose they lead to: so
/// few would rather fit by chance where the camera is expected.
bool Tracker::predict_by_reference(Frame& frame, TrackResult& result, std::size_t every) {
  const KeyFrameView& reference = replica_.keyframes().at(reference_);
  std::vector<DescriptorQuery> queries;
  std::vector<LandmarkId> landmarks;
  // What the keyframe's feature lies on, as its descriptor; how it moves, as last seen.
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

PoseObservation Tracker::observation(const Frame& frame, std::size_t feature,
                                     const LandmarkView& landmark) const {
  const StereoPixel pixel = frame.features->stereo_pixel(feature, scales_);
  return {landmark.p_w, pixel.u, pixel.v, pixel.u_right, pixel.inv_sigma};
}

/// Pose from the frame's landmarks; outliers lose theirs. Returns the inliers. Unless it `expects`
/// the camera to go on as it did, all poses are alike to it.
int Tracker::refine_pose(Frame& frame, TrackResult& result, bool expects) const {
  result.held = false;
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
  const std::optional<ExpectedPose> expected =
      expects ? expected_pose(frame.timestamp) : std::nullopt;
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
    // A camera that turns back at once is not where it was expected: predict() tells.
    const double away = distance(consensus.pose.T_c_w, expected->T_c_w);
    const bool doubtful =
        consensus.pose.inliers < kDoubtfulShare * static_cast<double>(observations.size()) &&
        away > options_.consensus.max_acceleration * reach;
    if (!doubtful && position_sigma(consensus.pose) > kStarved * prior.sigma_position) {
      PoseOptions held;
      held.prior = prior;
      consensus = estimate(expected->T_c_w, held);
      result.held = true;
    }
  }
  frame.T_c_w = consensus.pose.T_c_w;
  result.overruled |= consensus.overruled;
  for (std::size_t k = 0; k < features.size(); ++k) {
    if (consensus.pose.outlier[k] != 0) frame.landmarks[features[k]] = {};
  }
  return consensus.pose.inliers;
}

/// Whether the camera can have come to the frame's pose from its last motion.
bool Tracker::is_expected(const Frame& frame) const {
  const std::optional<ExpectedPose> expected = expected_pose(frame.timestamp);
  if (!expected || options_.acceleration <= 0) return false;
  const double away = distance(frame.T_c_w, expected->T_c_w);
  return away <= options_.consensus.max_acceleration * expected->reach;
}

/// Whether no camera can have come to the frame's pose from its last motion.
bool Tracker::is_jump(const Frame& frame) const {
  const std::optional<ExpectedPose> expected = expected_pose(frame.timestamp);
  if (!expected) return false;
  const double away = distance(frame.T_c_w, expected->T_c_w);
  return away > kImpossible * expected->reach;
}

/// What a match says about the pose by being on a thing that can move. The frame knows better than
/// the landmark, which speaks where the frame has no prior.
Vote Tracker::vote(const kys::Prior& keypoint, const kys::Prior& landmark) const {
  const kys::Prior& prior = keypoint.label != kys::kVoidLabel ? keypoint : landmark;
  if (start_.mobility(prior.label) == kys::Mobility::kFixed || prior.instance < 0) return {};
  const double odds = instances_ ? instances_->log_odds(prior.instance) : start_.log_odds(prior);
  return {prior.instance, static_cast<float>(std::clamp(odds, -kMaxVote, kMaxVote))};
}

bool Tracker::track_local_map(Frame& frame, TrackResult& result) {
  const LocalMap local = local_map_gatherer_.gather(replica_, frame.landmarks);
  if (local.reference.valid()) reference_ = local.reference;
  const std::vector<LandmarkId> predicted = frame.landmarks;
  match_local_landmarks(frame, local, result);
  result.matches = count_landmarks(frame.landmarks);
  if (frame.left != nullptr) {
    frame.features =
        patches_.align(replica_, frame.T_c_w, frame.landmarks, *frame.left, *frame.features);
  }
  const std::vector<LandmarkId> matched = frame.landmarks;
  result.inliers = refine_pose(frame, result);
  for (const LandmarkId id : predicted) {
    if (id.valid()) count_visible(id);
  }
  for (std::size_t i = 0; i < matched.size(); ++i) {
    if (frame.landmarks[i].valid()) counts_.at(frame.landmarks[i]).found += 1;
  }
  const bool sure = is_expected(frame) && result.inliers >= kDoubtfulShare * result.matches;
  const int wanted = sure ? options_.min_held_inliers : options_.min_local_inliers;
  if (result.inliers >= wanted) return true;
  result.reason += "; local map: " + std::to_string(result.inliers) + " inliers";
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
  for (const LandmarkId id : local.landmarks) {
    const LandmarkView& landmark = replica_.landmarks().at(id);
    const auto view = predict_view(camera_, scales_, frame.T_c_w, centre, landmark);
    if (!view || std::binary_search(held.begin(), held.end(), id)) continue;
    // The straighter the view, the better the prediction.
    const float radius = (view->cosine > 0.998f ? 2.5f : 4.0f) * options_.local_radius;
    queries.push_back(
        query_for(*view, radius, scales_, landmark.descriptor, *prior_of(landmark, priors)));
    landmarks.push_back(id);
    count_visible(id);
  }
  SearchOptions options;
  options.max_distance = options_.max_distance;
  options.ratio = options_.local_ratio;
  options.taken = taken;
  const std::vector<SearchMatch> matches =
      search_features(*frame.features, scales_, queries, options, *model_, result.statistics);
  assign(matches, landmarks, frame.landmarks);
}

void Tracker::count_visible(LandmarkId id) {
  if (VisibilityCount* count = counts_.find(id)) {
    count->visible += 1;
  } else {
    counts_.put(id, {id, 1, 0});
    counted_.push_back(id);
  }
}

/// The counts since the last keyframe, by id.
std::vector<VisibilityCount> Tracker::take_counts() {
  std::sort(counted_.begin(), counted_.end());
  std::vector<VisibilityCount> counts;
  counts.reserve(counted_.size());
  for (const LandmarkId id : counted_) {
    counts.push_back(counts_.at(id));
    counts_.erase(id);
  }
  counted_.clear();
  return counts;
}

KeyFrameSituation Tracker::situation(const Frame& frame, int inliers, int waiting) const {
  KeyFrameSituation s;
  s.frames_since_keyframe = static_cast<int>(frame.index - last_keyframe_frame_);
  // In a loaded map that nothing was added to there is no last keyframe yet.
  s.keyframes_in_map = last_keyframe_.valid() ? 1 + static_cast<int>(last_keyframe_.value) -
                                                    static_cast<int>(first_keyframe_.value)
                                              : static_cast<int>(replica_.keyframes().size());
  s.inliers = inliers;
  s.waiting = waiting;
  if (inliers < options_.keyframes.scarce) s.addable = count_addable(frame);
  const std::size_t min_observers = s.keyframes_in_map <= 2 ? 2 : 3;
  for (const LandmarkId id : replica_.keyframes().at(reference_).landmarks) {
    const LandmarkView* landmark = replica_.landmarks().find(id);
    // A stereo observation counts twice, and most are: one observer less is enough.
    if (landmark != nullptr && 2 * landmark->observers.size() >= min_observers) {
      ++s.reference_landmarks;
    }
  }
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const float depth = frame.features->depth(i);
    if (depth <= 0 || depth > close_depth_ || !is_believed_static(frame.features->prior(i)))
      continue;
    ++(frame.landmarks[i].valid() ? s.tracked_close : s.untracked_close);
  }
  return s;
}

/// Stereo points that a keyframe would add as landmarks were it to add all.
int Tracker::count_addable(const Frame& frame) const {
  int count = 0;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    if (frame.landmarks[i].valid() || !frame.features->has_stereo(i)) continue;
    count += is_believed_static(frame.features->prior(i)) ? 1 : 0;
  }
  return count;
}

KeyFrameMessage Tracker::make_keyframe(Frame& frame) {
  KeyFrameMessage message;
  frame.features = with_beliefs(std::move(frame.features));
  if (instances_) message.beliefs = instances_->take_changed_beliefs();
  if (frame.left != nullptr) {
    frame.features = patches_.with_origins(frame.landmarks, *frame.features);
  }
  message.id = {next_keyframe_++};
  message.frame_index = frame.index;
  message.timestamp = frame.timestamp;
  message.T_c_w = frame.T_c_w;
  message.features = frame.features;
  message.tracked = frame.landmarks;
  message.reference = reference_;
  if (reference_.valid()) {
    message.T_c_reference = frame.T_c_w * replica_.keyframes().at(reference_).T_c_w.inverse();
  }
  add_stereo_landmarks(frame, message);
  for (const NewLandmark& landmark : message.new_landmarks) {
    frame.landmarks[landmark.feature] = landmark.id;
  }
  message.counts = take_counts();

  // The replica has it at once; the back end's view of it follows in a change set.
  KeyFrameView view;
  view.submap = reference_.valid() ? submap(reference_) : message.id;
  view.T_c_w = frame.T_c_w;
  view.features = frame.features;
  view.landmarks = frame.landmarks;
  if (reference_.valid()) view.neighbours.push_back(reference_);
  view.parent = reference_;
  replica_.put_pending(message.id, std::move(view));
  for (const LandmarkId id : message.tracked) replica_.add_observer(id, message.id);
  if (frame.left != nullptr) {
    patches_.keep(message.id, frame.landmarks, *frame.left, *frame.features);
  }
  reference_ = last_keyframe_ = message.id;
  last_keyframe_frame_ = frame.index;
  return message;
}

/// Every close stereo point without a landmark becomes one; where close ones are few, the nearest
/// hundred.
void Tracker::add_stereo_landmarks(const Frame& frame, KeyFrameMessage& message) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < frame.features->size(); ++i) {
    if (frame.features->has_stereo(i) && is_believed_static(frame.features->prior(i)))
      order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return frame.features->depth(a) < frame.features->depth(b);
  });
  // The first keyframe gives the map all it has: nothing else is there to track. Where little is
  // tracked the next ones do so as well.
  const bool all =
      !message.reference.valid() || count_landmarks(frame.landmarks) < options_.keyframes.scarce;
  constexpr std::size_t kNearest = 100;
  const Rigid3 T_w_c = frame.T_c_w.inverse();
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t i = order[k];
    const float depth = frame.features->depth(i);
    if (!all && depth > close_depth_ && k >= kNearest) break;
    if (frame.landmarks[i].valid()) continue;
    const Keypoint& keypoint = frame.features->keypoint(i);
    const Eigen::Vector3d p_w = T_w_c * camera_.back_project(keypoint.x, keypoint.y, depth);
    const LandmarkId id = landmark_ids_.next();
    message.new_landmarks.push_back({id, static_cast<std::uint32_t>(i), p_w});
    replica_.put(id, first_view(frame, i, p_w, message.id));
  }
  std::sort(message.new_landmarks.begin(), message.new_landmarks.end(),
            [](const NewLandmark& a, const NewLandmark& b) { return a.feature < b.feature; });
}

LandmarkView Tracker::first_view(const Frame& frame, std::size_t feature,
                                 const Eigen::Vector3d& p_w, KeyFrameId keyframe) const {
  const Eigen::Vector3d ray = p_w - frame.T_c_w.inverse_t();
  LandmarkView view;
  view.p_w = p_w;
  view.normal = ray.normalized().cast<float>();
  const ScaleLevels::DistanceRange range =
      scales_.distance_range(ray.norm(), frame.features->keypoint(feature).octave);
  view.min_distance = range.min;
  view.max_distance = range.max;
  view.descriptor = frame.features->descriptor(feature);
  view.prior = frame.features->prior(feature);
  view.observers = {keyframe};
  return view;
}

}  // namespace kys_slam
