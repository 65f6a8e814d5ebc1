// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/logic_error.h>
#include <kys_slam/util/memory.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/process_figures.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>
#include <utility>

#include "camera/plausible.h"
#include "map_file/map_file.h"
#include "motion/motion_of_mode.h"
#include "system/frame_notes.h"
#include "system/system_impl.h"

namespace kys_slam {

namespace {

constexpr std::size_t kManyLandmarks = 20000;  // changed at once: by a loop, not by one keyframe

std::string describe(const StereoCamera& c) {
  return fmt::format("{}x{} px, fx {:.9g}, fy {:.9g}, cx {:.9g}, cy {:.9g}, baseline {:.9g} m",
                     c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.baseline);
}

/// Labels of a map are in the label space of the name that it says.
void check_labels(const Map& map, const std::string& label_space,
                  const std::filesystem::path& file) {
  int most = -1;
  const auto see = [&](const kys::Prior& prior) {
    if (prior.label != kys::kVoidLabel) most = std::max<int>(most, prior.label);
  };
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) {
    for (const kys::Prior& prior : k.features->priors()) see(prior);
  });
  map.landmarks().for_each([&](LandmarkId, const Landmark& l) { see(l.prior); });
  if (most < 0 || most < static_cast<int>(things_of(label_space).size())) return;
  throw InputError(fmt::format("{}: label {} is not in label space {}", file.string(), most,
                               label_space_name(label_space)));
}

/// Features of one extractor say nothing about those of another.
void check_extractor(const ScaleLevels& of_map, const ScaleLevels& own,
                     const std::filesystem::path& file) {
  if (of_map.extractor != own.extractor) {
    throw InputError(file.string() + ": the map was made with features of '" + of_map.extractor +
                     "', not with those of '" + own.extractor + "'");
  }
  if (of_map.same_levels(own)) return;
  throw InputError(file.string() + ": the map was made with other " +
                   (own.extractor == kOrbName
                        ? "pyramid levels (orb.levels, orb.scale_factor)"
                        : "levels, reach or standard deviation of '" + own.extractor + "'"));
}

}  // namespace

System::System(const StereoCamera& camera, const Settings& settings, Schedule schedule,
               std::unique_ptr<PriorProvider> priors, std::unique_ptr<FeatureExtractor> features) {
  settings.check();
  if (!features) features = make_orb_extractor(settings);
  check_traits(features->traits());
  if (!camera.is_valid()) throw InputError("the camera's calibration makes no sense");
  require_plausible(camera, "the camera's calibration makes no sense");
  constexpr std::size_t kBytesPerPixel = 10;  // two pyramids, and one blurred
  check_memory(fmt::format("tracking in images of {}x{}", camera.width, camera.height),
               kBytesPerPixel * static_cast<std::size_t>(camera.width) *
                   static_cast<std::size_t>(camera.height));
  impl_ =
      std::make_unique<Impl>(camera, settings, schedule, std::move(priors), std::move(features));
  impl_->first_note = other_image_size(camera.cx, camera.cy, camera.width, camera.height);
  add_phrase(impl_->first_note, unequal_focal_lengths(camera.fx, camera.fy));
}

System::~System() = default;

void System::load_map(const std::filesystem::path& file, bool localize_only) {
  Impl& s = *impl_;
  const std::lock_guard lock(s.mutex);
  if (s.count > 0) throw LogicError("a map can be loaded before the first frame only");
  if (s.map_loaded) throw LogicError("a map can be loaded once only");
  Map map = kys_slam::load_map(file, label_space_name(s.options.control.label_space));
  if (localize_only && map.keyframes().empty()) {
    throw InputError(file.string() + ": holds no keyframes");
  }
  check_labels(map, s.options.control.label_space, file);
  if (!(map.camera() == s.camera)) {
    throw InputError(
        file.string() + ": the map was made with another camera (" + describe(map.camera()) +
        ") than this one (" + describe(s.camera) +
        "); give the calibration that the map was made with, or make a map with this one");
  }
  check_extractor(map.scales(), s.scales, file);
  if (const bool beliefs = s.model.uses_belief(); map.keeps_beliefs() != beliefs) {
    map = Map(with_motion_of_mode(map.contents(), beliefs, make_belief_start(s.options, s.model)));
  }
  if (s.priors) {
    const std::vector<std::uint8_t> is_thing = things_of(s.options.control.label_space);
    s.instance_end = map.instance_end(is_thing);
    s.front_end.raise_instances(s.instance_end, is_thing);
  }
  s.map_loaded = true;
  s.first_keyframe = {map.keyframe_id_end()};
  s.tracker.continue_map(map.keyframe_id_end(), map.landmark_id_end(), localize_only);
  ChangeSet changes = s.runner.continue_map(std::move(map));
  s.front_end.set_rig(changes.rig);
  s.front_end.hold_rig();
  s.tracker.apply(std::move(changes));
}

void System::start_rig(const RigEstimate& rig) {
  Impl& s = *impl_;
  const std::lock_guard lock(s.mutex);
  if (s.count > 0 || s.map_loaded) {
    throw LogicError("a correction of the rig is given before the first frame and any map");
  }
  RigEstimate own{RigCorrection(s.camera, rig.correction.parameters()), rig.covariance};
  // What is said to be exact is known to a thousandth of what is usual: estimates divide by it.
  own.covariance.diagonal() += 1e-6 * rig_prior().diagonal();
  s.front_end.start_rig(own);
  s.runner.start_rig(own);
}

void System::save_map(const std::filesystem::path& file) const {
  const std::unique_lock lock(impl_->mutex);
  const Map& map = impl_->quiet_map(lock);
  if (impl_->runner.failed()) {
    throw InputError("cannot write " + file.string() + ": mapping failed, the map is not sound");
  }
  kys_slam::save_map(map, file, label_space_name(impl_->options.control.label_space));
}

void System::Impl::check_input(const StereoFrame& frame, const StereoMasks& masks) const {
  const std::string name = frame.name.empty() ? std::to_string(frame.index) : frame.name;
  if (!std::isfinite(frame.timestamp)) throw InputError("frame " + name + ": time is not finite");
  if (!reports.empty() && !(frame.timestamp > reports.back().timestamp)) {
    throw InputError("frame " + name + ": its time stamp does not follow the one before");
  }
  if (frame.left_features.has_value() != frame.right_features.has_value()) {
    throw InputError("frame " + name + ": features of one image only");
  }
  const auto check_size = [&](const GrayImage& image, const char* what) {
    if (image.width() == camera.width && image.height() == camera.height) return;
    throw InputError("frame " + name + ": " + what + " of " + std::to_string(image.width()) + "x" +
                     std::to_string(image.height()) + " px where the calibration says " +
                     std::to_string(camera.width) + "x" + std::to_string(camera.height));
  };
  for (const GrayImage* mask : {&masks.left, &masks.right}) {
    if (!mask->empty()) check_size(*mask, "a mask");
  }
  if (frame.left_features) {
    const std::size_t levels = scales.scale.size();
    if (scales.extractor != kOrbName) {
      throw InputError("frame " + name + ": has features of its own, where " + scales.extractor +
                       " finds those of images");
    }
    const auto check = [&](const FeatureSet& set, const char* side) {
      check_feature_set(set, camera.width, camera.height, levels, kMostFeatures,
                        "frame " + name + side, "orb.levels");
    };
    check(*frame.left_features, ", left image");
    check(*frame.right_features, ", right image");
    return;
  }
  for (const GrayImage* image : {&frame.left, &frame.right}) check_size(*image, "an image");
}

/// Steps of the back end reach the tracker, their figures the report of their keyframe.
void System::Impl::apply(std::vector<BackEndStep> steps) {
  for (BackEndStep& step : steps) {
    front_end.set_rig(step.changes.rig);
    const bool whole_map = step.changes.moved_landmarks.size() > kManyLandmarks;
    tracker.apply(std::move(step.changes));
    if (whole_map) return_freed_memory();
    FrameReport& report = reports.at(static_cast<std::size_t>(step.frame_index));
    report.times.local_mapping = step.report.total();
    report.times.local_bundle = step.report.bundle;
    report.times.loop = step.loop.total();
    report.statistics += step.report.statistics;
    note_loop(step);
  }
}

/// Two sub-maps have been joined.
void System::Impl::take_joint(BackEndStep step) {
  tracker.apply(std::move(step.changes));
  if (step.frame_index >= 0) note_loop(step);
}

/// What loop closing found with the keyframe of a frame.
void System::Impl::note_loop(const BackEndStep& step) {
  FrameReport& report = reports.at(static_cast<std::size_t>(step.frame_index));
  report.statistics += step.loop.statistics;
  if (!step.loop.closed) return;
  report.loop = step.loop.merged ? LoopEvent::kMerged : LoopEvent::kClosed;
  report.loop_gap_m = step.loop.gap;
  report.loop_distance_m = step.loop.distance;
  if (!(*step.loop.closed < first_keyframe)) {
    report.loop_frame = reports.at(static_cast<std::size_t>(step.loop.closed_frame)).index;
  }
}

/// Waits for all steps.
void System::Impl::drain() {
  while (true) {
    std::vector<BackEndStep> steps = runner.drain();
    if (steps.empty()) return;
    apply(std::move(steps));
  }
}

void System::Impl::note(const TrackResult& tracked, const FrontEndResult& seen,
                        FrameReport& report) const {
  switch (tracked.status) {
    case TrackingStatus::kStarted:
      report.status = FrameStatus::kStarted;
      break;
    case TrackingStatus::kTracked:
      report.status = FrameStatus::kTracked;
      break;
    case TrackingStatus::kLost:
      report.status = FrameStatus::kLost;
      break;
  }
  report.reason = tracked.reason;
  report.relocalised = tracked.relocalised;
  if (tracked.status == TrackingStatus::kLost && seen.features->size() == 0) {
    report.reason = "the image has no corners";
  }
  if (!is_by_parallax(seen.fault, *seen.features, camera.width)) report.warning = seen.fault;
  if (report.warning.empty() && tracked.jumped) {
    report.warning =
        "the camera seems to move as none can: time stamps that are wrong or irregular, lost "
        "frames, "
        "or it follows something that moves";
  }
  note_integrity(tracked.integrity, report);
  report.T_w_c = tracked.T_c_w.inverse();
  if (tracked.status != TrackingStatus::kLost && tracker.present_submap().valid()) {
    report.submap = static_cast<std::int64_t>(tracker.present_submap().value);
  }
  report.keypoints = static_cast<int>(seen.features->size());
  report.stereo_matches = seen.stereo_matches;
  report.matches = tracked.matches;
  report.inliers = tracked.inliers;
  report.prior_coverage = seen.prior_coverage;
  report.masked = seen.masked;
  report.statistics = seen.statistics;
  report.statistics += tracked.statistics;
  report.times.extract = seen.times.extract;
  report.times.priors = seen.times.priors;
  report.times.stereo = seen.times.stereo;
  report.times.predict = tracked.times.predict;
  report.times.local_map = tracked.times.local_map;
  report.resident_mb = resident_memory_mb();
}

void System::Impl::note_uncertainty(const TrackResult& tracked, FrameReport& report) const {
  if (!tracked.uncertainty) return;
  const PoseUncertainty& u = *tracked.uncertainty;
  if (!u.covariance.pose.allFinite()) return;
  RelativePose& local = report.local.emplace();
  local.T_other_c = u.T_reference_c;
  local.covariance = u.covariance.pose;
  if (!(u.reference < first_keyframe)) {
    local.other = keyframe_frames.at(u.reference.value - first_keyframe.value);
  }
  if (!u.covariance.motion || !u.covariance.motion->allFinite()) return;
  report.motion = {reports.at(static_cast<std::size_t>(u.last)).index, u.T_last_c,
                   *u.covariance.motion};
}

/// Searches the whole map for a frame, and resumes tracking where it is. The back end is waited
/// for, so that the answer depends on the frames alone.
/// \param elsewhere not in the sub-map of the last frame with a pose
TrackResult System::Impl::resume(const StereoFrame& frame, FrontEndResult& seen, bool elsewhere) {
  TrackResult lost;
  if (!options.relocalization.enabled || seen.features->size() == 0) return lost;
  drain();
  front_end.renew(seen);
  const KeyFrameId except = elsewhere ? tracker.present_submap() : KeyFrameId{};
  const auto place =
      runner.relocalize(*tracker.with_beliefs(seen.features), except, lost.statistics);
  if (!place) return lost;
  if (elsewhere) {
    take_joint(runner.join_at(*tracker.with_beliefs(seen.features), *place, except));
  }
  TrackResult resumed =
      tracker.resume(input(frame, seen), {place->keyframe, place->T_c_w, place->landmarks}, 0);
  resumed.statistics += lost.statistics;
  return resumed;
}

/// The whole map is searched for a lost frame; when that fails, it may start a new sub-map, to be
/// merged when a known place is seen again.
TrackResult System::Impl::recover(const StereoFrame& frame, FrontEndResult& seen,
                                  TrackResult lost) {
  TrackResult resumed = resume(frame, seen, false);
  resumed.statistics += lost.statistics;
  if (resumed.status != TrackingStatus::kLost) return resumed;
  lost.statistics = resumed.statistics;
  lost.refused |= resumed.refused;
  if (!resumed.reason.empty()) lost.reason += "; " + resumed.reason;
  if (!options.relocalization.enabled || !tracker.can_start(*seen.features)) return lost;
  if (!restart.is_due(lost.refused)) return lost;
  TrackResult started = tracker.start_submap(input(frame, seen));
  started.statistics += lost.statistics;
  return started;
}

/// The pose of a frame, in the map where the last one was or elsewhere.
TrackResult System::Impl::find(const StereoFrame& frame, FrontEndResult& seen) {
  kys::Statistics statistics;
  if (restart.is_provisional()) {
    TrackResult resumed = resume(frame, seen, true);
    if (resumed.status != TrackingStatus::kLost) return resumed;
    statistics = resumed.statistics;
  }
  TrackResult tracked = tracker.track(input(frame, seen), runner.waiting());
  if (tracked.status == TrackingStatus::kLost && tracker.has_map()) {
    tracked = recover(frame, seen, std::move(tracked));
  }
  tracked.statistics += statistics;
  return tracked;
}

FrameReport System::feed(const StereoFrame& frame, const StereoMasks& masks) {
  Impl& s = *impl_;
  FrameReport report;
  FrameObserver observer;
  {
    const std::lock_guard lock(s.mutex);
    report = s.feed(frame, masks);
    observer = s.observer;
  }
  // Without the lock, so that the observer may ask for the map.
  if (observer) {
    observer({&s.seen_report, s.seen_keypoints, s.seen_depths, s.seen_features->priors(),
              s.seen_landmarks, s.seen_tiers, s.seen_instances});
  }
  return report;
}

FrameReport System::feed(double timestamp, const ImageView& left, const ImageView& right,
                         const StereoMasks& masks) {
  StereoFrame frame;
  frame.index = impl_->count;
  frame.timestamp = timestamp;
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->set_images(left, right, frame);
  }
  return feed(frame, masks);
}

void System::set_observer(FrameObserver observer) {
  const std::lock_guard lock(impl_->mutex);
  impl_->observer = std::move(observer);
}

/// Keeps what the observer gets.
void System::Impl::observe(const FrameReport& report, const FrameFeatures& features,
                           std::span<const InstanceState> instances) {
  seen_report = report;
  seen_keypoints.assign(features.keypoints().begin(), features.keypoints().end());
  for (std::size_t i = 0; i < features.size(); ++i) {
    const RigCorrection::Measured m = features.measured(i);
    seen_keypoints[i].x = m.u;
    seen_keypoints[i].y = m.v;
  }
  seen_depths.resize(features.size());
  seen_landmarks.assign(features.size(), -1);
  seen_tiers.assign(features.size(), kys::Tier::kSkipped);
  seen_instances.clear();
  for (const InstanceState& i : instances) {
    if (i.keypoints == 0) continue;  // nothing of it was compared
    seen_instances.push_back({i.instance, i.label, 1 - i.p_static, i.keypoints});
  }
  const std::span<const LandmarkId> landmarks = tracker.last_landmarks();
  const bool tracked = report.status != FrameStatus::kLost && landmarks.size() == features.size();
  for (std::size_t i = 0; i < features.size(); ++i) {
    seen_depths[i] = features.depth(i);
    if (!tracked || !landmarks[i].valid()) continue;
    seen_landmarks[i] = static_cast<std::int64_t>(landmarks[i].value);
    const LandmarkView* landmark = tracker.replica().landmarks().find(landmarks[i]);
    if (landmark == nullptr) continue;
    const kys::Prior prior = tracker.with_belief(features.prior(i));
    seen_tiers[i] = model
                        .evaluate(features.descriptor(i), prior, landmark->descriptor,
                                  tracker.with_belief(landmark->prior), kys::Context::kTemporal)
                        .tier;
  }
}

FrameReport System::Impl::feed(const StereoFrame& frame, const StereoMasks& masks) {
  Impl& s = *this;
  if (finished) throw LogicError("a frame was fed after finish()");
  s.check_input(frame, masks);
  Stopwatch watch;
  if (s.options.control.stall_ms > 0) {
    s.stall.wait_for(std::chrono::milliseconds(s.options.control.stall_ms));
    watch.lap_ms();  // the paper's delay stands outside the tracking time
  }
  FrontEndResult seen = s.front_end.process(frame, masks);
  const bool same = s.drop_same_image(frame, seen);
  const std::vector<SegmentQueue::Delivery> arrived = s.take_segments(seen);
  Stopwatch track_watch;
  FrameReport report;
  report.index = frame.index;
  report.name = frame.name;
  report.timestamp = frame.timestamp;
  const bool hold = s.must_hold(arrived, seen);
  if (!hold && !s.held.empty()) s.track_held(arrived);
  if (hold) {
    s.hold(frame, seen, report);
  } else {
    s.track(frame, seen, arrived, report);
  }
  s.note_masks(masks, report);
  if (same) {
    report.reason = kSameImage;
    add_phrase(report.warning, kSameImage);
  }
  add_phrase(report.warning, std::exchange(s.first_note, ""));
  add_phrase(report.warning, note_of_times(s.reports));
  add_phrase(report.warning, s.segments.take_warning());
  report.times.track = track_watch.lap_ms();
  report.times.total = watch.elapsed_ms();
  s.reports.back() = report;
  s.seen_report = report;
  return report;
}

/// Pose, keyframe and reports of frame number `count`.
void System::Impl::track(const StereoFrame& frame, FrontEndResult& seen,
                         const std::vector<SegmentQueue::Delivery>& arrived, FrameReport& report) {
  apply(runner.collect(count));
  front_end.renew(seen);
  report.segments_of = attach_segments(frame, seen, arrived);
  const bool had_map = tracker.has_map();
  TrackResult tracked = find(frame, seen);
  if (tracked.status == TrackingStatus::kStarted && had_map) restart.started();
  if (tracked.status == TrackingStatus::kTracked) restart.tracked(tracked.relocalised);
  if (tracker.has_map()) front_end.hold_rig();
  report.keyframe = tracked.keyframe.has_value();
  note(tracked, seen, report);
  note_uncertainty(tracked, report);
  if (tracked.keyframe) keyframe_frames.push_back(frame.index);
  record(std::move(tracked), seen, report);
}

/// The frame's place in all lists, and its keyframe to the back end.
void System::Impl::record(TrackResult tracked, const FrontEndResult& seen,
                          const FrameReport& report) {
  reports.push_back(report);
  if (observer) {
    seen_features = seen.features;
    observe(report, *seen.features, tracked.instances);
  }
  frame_poses.add(tracked.pose);
  objects.add(tracked.taken, tracked.instances);
  if (tracked.keyframe && options.control.blend_poses) {
    frame_poses.close(tracked.keyframe->id, tracker);
  }
  if (late_segments) late_segments->add(count, tracked, seen.features, tracker);
  ++count;
  if (tracked.keyframe) runner.submit(std::move(*tracked.keyframe));
}

void System::finish() {
  const std::lock_guard lock(impl_->mutex);
  if (impl_->finished) return;
  impl_->finished = true;
  if (!impl_->held.empty()) impl_->track_held({});
  impl_->drain();
  impl_->runner.set_priors(impl_->tracker.take_late_priors());
  BackEndEnd end = impl_->runner.finish();
  for (BackEndStep& joined : end.joined) impl_->take_joint(std::move(joined));
  impl_->tracker.apply(std::move(end.last));
}

void System::interrupt() {
  impl_->stall.interrupt();
  impl_->segments.end();
  impl_->runner.interrupt();
}

}  // namespace kys_slam
