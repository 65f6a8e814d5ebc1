// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/local_mapper.h"

#include <kys_slam/check_options.h>
#include <kys_slam/util/stopwatch.h>

namespace kys_slam {

void describe(kys::OptionList& list, LocalMapperOptions& o) {
  describe(list, o.landmark_culling);
  describe(list, o.triangulation);
  describe(list, o.fusion);
  describe(list, o.bundle);
  describe(list, o.keyframe_culling);
  describe(list, o.sparsification);
  describe(list, o.thinning);
  list.add("mapping.adjust_frames", o.adjust_frames, {1, 100}, "frames",
           "least number of frames between two keyframes that are mapped in full: triangulation, "
           "fusion, local bundle adjustment; those between add observations and stereo landmarks");
  describe(list, o.calibration);
  list.add("belief.patience", o.mover_patience, {0, 1e6}, "s",
           "after which landmarks on a moving instance are erased");
}

LocalMapper::LocalMapper(const LocalMapperOptions& options, const kys::DistanceModel& model)
    : options_(checked(options)),
      model_(&model),
      calibration_(options.calibration),
      sparsification_(options.sparsification),
      thinning_(options.thinning) {}

void LocalMapper::continue_map(const Map& map) {
  landmark_ids_.continue_after(map.landmark_id_end());
  thinning_.continue_map(map);
  options_.calibration.enabled = false;
  calibration_ = RigCalibration(options_.calibration);
}

LocalMapperReport LocalMapper::process(Map& map, const KeyFrameMessage& message,
                                       const std::atomic<bool>* stop, bool behind) {
  LocalMapperReport report;
  Stopwatch watch;
  const KeyFrameId id = message.id;
  insert_keyframe(map, message);
  for (const KeyFramePriors& late : message.late_priors) map.set_priors(late.keyframe, late.priors);
  map.set_beliefs(message.beliefs, options_.mover_patience);
  for (const NewLandmark& landmark : message.new_landmarks) recent_.add(landmark.id);
  report.landmarks_culled = recent_.cull(map, id, options_.landmark_culling);
  sparsification_.add(id);
  report.keyframes_thinned = thinning_.update(map, id);
  report.insert = watch.lap_ms();
  if (is_mapped_in_full(map, message, behind)) {
    mapped_ = message.frame_index;
    map_in_full(map, id, report, stop);
  }
  return report;
}

/// The first keyframes of a sub-map are: all depends on them.
bool LocalMapper::is_mapped_in_full(const Map& map, const KeyFrameMessage& message,
                                    bool behind) const {
  constexpr std::uint32_t kFirst = 5;
  if (message.id.value < map.keyframe(message.id).submap.value + kFirst) return true;
  return !behind && message.frame_index >= mapped_ + options_.adjust_frames;
}

void LocalMapper::map_in_full(Map& map, KeyFrameId id, LocalMapperReport& report,
                              const std::atomic<bool>* stop) {
  Stopwatch watch;
  const std::vector<LandmarkId> made = triangulate_landmarks(
      map, id, landmark_ids_, options_.triangulation, *model_, report.statistics);
  for (const LandmarkId landmark : made) recent_.add(landmark);
  report.triangulated = static_cast<int>(made.size());
  report.triangulate = watch.lap_ms();

  report.fused = fuse_landmarks(map, id, options_.fusion, *model_, report.statistics);
  report.fuse = watch.lap_ms();

  if (map.keyframes().size() > 2) {
    report.bundle_report = adjust_locally(map, id, options_.bundle, stop);
  }
  report.bundle = watch.lap_ms();

  report.keyframes_culled = cull_keyframes(map, id, options_.keyframe_culling);
  if (!report.bundle_report.window.empty()) {
    report.keyframes_culled += sparsification_.update(map, report.bundle_report.window);
  }
  report.cull = watch.lap_ms();
  calibration_.update(map, keyframes_seen(map), stop);
  report.calibrate = watch.lap_ms();
}

void insert_keyframe(Map& map, const KeyFrameMessage& message) {
  KeyFrame keyframe;
  keyframe.id = message.id;
  keyframe.frame_index = message.frame_index;
  keyframe.timestamp = message.timestamp;
  keyframe.features = message.features;
  keyframe.T_c_w = message.T_c_w;
  if (const auto T_r_w = map.pose(message.reference)) {
    keyframe.T_c_w = scaled(message.T_c_reference, map.scale() / message.scale) * *T_r_w;
  }
  keyframe.motion = message.motion;
  const Rigid3 T_w_c = keyframe.T_c_w.inverse();
  map.add_keyframe(std::move(keyframe));

  // The disparity offset may have changed since the tracker computed the depth.
  const FrameFeatures& features = *map.keyframe(message.id).features;
  const auto depth_ratio = [&](std::uint32_t feature) {
    const double depth = features.depth(feature);
    const double before = message.features->depth(feature);
    return depth > 0 && before > 0 ? depth / before : 1.0;
  };

  for (const VisibilityCount& count : message.counts) {
    const LandmarkId id = map.resolve(count.id);
    if (id.valid()) map.add_visible(id, count.visible, count.found);
  }
  for (std::size_t i = 0; i < message.tracked.size(); ++i) {
    if (!message.tracked[i].valid()) continue;
    const LandmarkId id = map.resolve(message.tracked[i]);
    if (!id.valid()) continue;
    if (map.add_observation(id, message.id, static_cast<std::uint32_t>(i))) {
      map.refresh_landmark(id);
    } else {
      map.publish(id);
    }
  }
  for (const NewLandmark& made : message.new_landmarks) {
    Landmark landmark;
    landmark.id = made.id;
    landmark.p_w = T_w_c * (depth_ratio(made.feature) * (message.T_c_w * made.p_w));
    landmark.first_keyframe = message.id;
    map.add_landmark(std::move(landmark));
    if (!map.add_observation(made.id, message.id, made.feature)) {
      map.erase_landmark(made.id);  // its feature was taken by a landmark seen again
      continue;
    }
    map.refresh_landmark(made.id);
  }
  KeyFrameId otherwise = message.reference;
  while (otherwise.valid() && !map.has(otherwise)) otherwise = map.culled_parent(otherwise);
  map.connect_to_spanning_tree(message.id, otherwise);
}

}  // namespace kys_slam
