// SPDX-License-Identifier: BSD-3-Clause
#include "measure/place_run.h"

#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/progress.h>
#include <time.h>

#include <algorithm>
#include <numbers>
#include <utility>

#include "features/pair_extractor.h"
#include "loop_closing/strict_distances.h"
#include "measure/stored_features.h"
#include "tracking/front_end.h"

namespace kys_slam {

namespace {

/// Processor time of this thread: on a busy machine the clock on the wall says nothing.
double processor_ms() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double degrees(double radians) {
  return radians * 180 / std::numbers::pi;
}

std::unique_ptr<FeatureExtractor> make_extractor(const PlaceRunOptions& options) {
  if (!options.stored.empty()) return open_stored_features(options.stored);
  OrbOptions orb;
  orb.features = options.features;
  return make_orb_extractor(orb);
}

/// As the system does it.
PlaceRunOptions as_strict_for(const ExtractorTraits& traits, PlaceRunOptions options) {
  options.places = strict_places(traits.distances, options.places);
  make_strict(traits.distances, options.verification);
  return options;
}

}  // namespace

PlaceRun::PlaceRun(const std::filesystem::path& folder, const PlaceRunOptions& options)
    : PlaceRun(folder, options, make_extractor(options)) {}

PlaceRun::PlaceRun(const std::filesystem::path& folder, const PlaceRunOptions& options,
                   std::unique_ptr<FeatureExtractor> extractor)
    : options_(as_strict_for(extractor->traits(), options)), index_(options_.places) {
  const auto sequence = open_euroc_sequence(folder);
  camera_ = sequence->camera();
  std::vector<TimedPose> stamps;
  for (std::int64_t i = 0; i < sequence->frame_count(); i += options.every) {
    stamps.push_back({sequence->frame(i).timestamp, {}});
  }
  const TrajectoryPair truth = associate_by_time(sequence->ground_truth(), stamps);
  if (truth.size() == 0) throw InputError(folder.string() + ": no frame has a true pose");

  const ExtractorTraits& traits = extractor->traits();
  StereoOptions stereo;
  stereo.max_distance = equivalent_distance(stereo.max_distance, traits.distances);
  map_ = std::make_unique<Map>(camera_, ScaleLevels(traits));
  FrontEnd front_end(camera_, std::move(extractor), stereo, RowOptions{}, model_, nullptr);
  Progress progress("features", static_cast<std::int64_t>(truth.size()));
  for (std::int64_t i = 0; i < sequence->frame_count() && places_.size() < truth.size(); ++i) {
    const double stamp = sequence->frame(i).timestamp;
    if (stamp != truth.estimate[places_.size()].timestamp) continue;
    const StereoFrame frame = sequence->read(i);
    const Rigid3& T_w_c = truth.reference[places_.size()].T_w_c;
    places_.push_back({i, frame.name, stamp, T_w_c, front_end.process(frame).features});
    progress.update(static_cast<std::int64_t>(places_.size()));
    if (static_cast<std::int64_t>(places_.size()) == options.frames) break;
  }
}

void PlaceRun::run() {
  std::size_t indexed = 0;
  Progress progress("queries", static_cast<std::int64_t>(places_.size()));
  for (std::size_t q = 0; q < places_.size(); ++q) {
    while (places_[q].timestamp - places_[indexed].timestamp > options_.gap) {
      add_keyframe(indexed++);
    }
    index_.apply(map_->take_changes());
    if (indexed > 0) ask(q, indexed);
    progress.update(static_cast<std::int64_t>(q + 1));
  }
}

std::vector<std::pair<Keypoint, Keypoint>> PlaceRun::matches(const PairCheck& check,
                                                             std::size_t query) const {
  std::vector<std::pair<Keypoint, Keypoint>> pairs;
  for (std::size_t i = 0; i < check.place.landmarks.size(); ++i) {
    const LandmarkId id = check.place.landmarks[i];
    if (!id.valid()) continue;
    const Observation& seen = map_->landmark(id).observations.front();
    pairs.emplace_back(places_[query].features->keypoint(i),
                       map_->keyframe(seen.keyframe).features->keypoint(seen.feature));
  }
  return pairs;
}

double PlaceRun::mean_check_ms() const {
  return checks_ == 0 ? 0 : check_ms_ / checks_;
}

void PlaceRun::add_keyframe(std::size_t place) {
  const Place& p = places_[place];
  KeyFrame keyframe;
  keyframe.id = KeyFrameId{static_cast<std::uint32_t>(place)};
  keyframe.frame_index = static_cast<std::int64_t>(place);
  keyframe.timestamp = p.timestamp;
  keyframe.T_c_w = p.T_w_c.inverse();
  keyframe.features = p.features;
  const KeyFrameId id = keyframe.id;
  map_->add_keyframe(std::move(keyframe));
  if (place > 0) map_->connect_to_spanning_tree(id, KeyFrameId{id.value - 1});
  for (std::size_t i = 0; i < p.features->size(); ++i) {
    if (!p.features->has_stereo(i)) continue;
    const Keypoint& k = p.features->keypoint(i);
    Landmark landmark;
    landmark.id = LandmarkId{next_landmark_++};
    landmark.p_w = p.T_w_c * camera_.back_project(k.x, k.y, p.features->depth(i));
    landmark.first_keyframe = id;
    const LandmarkId landmark_id = landmark.id;
    map_->add_landmark(std::move(landmark));
    map_->add_observation(landmark_id, id, static_cast<std::uint32_t>(i));
    map_->refresh_landmark(landmark_id);
  }
}

double PlaceRun::overlap(const FrameFeatures& features, const Rigid3& T_k_q) const {
  int points = 0;
  int inside = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (!features.has_stereo(i)) continue;
    ++points;
    const Keypoint& k = features.keypoint(i);
    const Eigen::Vector3d p_k = T_k_q * camera_.back_project(k.x, k.y, features.depth(i));
    if (p_k.z() <= 0) continue;
    const Eigen::Vector2d pixel = camera_.project(p_k);
    inside += camera_.in_image(pixel.x(), pixel.y()) ? 1 : 0;
  }
  return points == 0 ? 0 : static_cast<double>(inside) / points;
}

void PlaceRun::ask(std::size_t query, std::size_t indexed) {
  const Place& place = places_[query];
  kys::Statistics statistics;
  const double start = processor_ms();
  const std::vector<PlaceCandidate> candidates =
      index_.query(*place.features, model_, statistics, {}, indexed);
  query_times_.push_back({index_.landmarks(), processor_ms() - start, statistics.total()});
  const std::size_t first = pairs_.size();
  for (std::size_t k = 0; k < indexed; ++k) {
    const Rigid3 T_k_q = places_[k].T_w_c.inverse() * place.T_w_c;
    PlacePair pair;
    pair.query = query;
    pair.keyframe = k;
    pair.distance = T_k_q.translation.norm();
    pair.angle = degrees(rotation_angle(T_k_q));
    pair.overlap = overlap(*place.features, T_k_q);
    pairs_.push_back(std::move(pair));
  }
  for (std::size_t r = 0; r < candidates.size(); ++r) {
    PlacePair& pair = pairs_[first + candidates[r].keyframe.value];
    pair.score = candidates[r].score;
    pair.votes = candidates[r].votes;
    pair.rank = static_cast<int>(r);
    if (pair.rank < options_.candidates) pair.check = check(query, pair.keyframe);
  }
}

PairCheck PlaceRun::check(std::size_t query, std::size_t keyframe) {
  const Place& place = places_[query];
  const KeyFrameId id{static_cast<std::uint32_t>(keyframe)};
  kys::Statistics statistics;
  PairCheck result;
  const double start = processor_ms();
  result.accepted =
      verify_place(*map_, *place.features, id, options_.verification, model_, statistics)
          .has_value();
  check_ms_ += processor_ms() - start;
  ++checks_;
  PlaceVerificationOptions lenient = options_.verification;
  lenient.min_descriptor_matches = 8;
  lenient.min_aligned = 6;
  lenient.min_inliers = 6;
  lenient.min_share = 0;
  lenient.min_observed = 0;
  const auto found = verify_place(*map_, *place.features, id, lenient, model_, statistics);
  if (!found) return result;
  result.inliers = found->inliers;
  result.in_view = found->in_view;
  const Rigid3 error = found->T_c_w * place.T_w_c;
  result.translation = error.translation.norm();
  result.rotation = degrees(rotation_angle(error));
  result.place = *found;
  return result;
}

}  // namespace kys_slam
