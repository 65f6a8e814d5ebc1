// SPDX-License-Identifier: BSD-3-Clause
#include "saved_map/merge_map.h"

#include <kys/distance_model.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "loop_closing/loop_closer.h"
#include "loop_closing/strict_distances.h"
#include "retrieval/place_index.h"

namespace kys_slam {

namespace {

constexpr double kSameCamera = 1e-6;  // of any number of the calibrations
constexpr double kSameRig = 1;        // px, largest difference of what two corrections make

void check_same_rig(const Map& map, const Map& other, const std::string& name) {
  const StereoCamera &a = map.camera(), &b = other.camera();
  const auto differ = [](double x, double y) {
    return std::abs(x - y) > kSameCamera * std::abs(x);
  };
  if (a.width != b.width || a.height != b.height || differ(a.fx, b.fx) || differ(a.fy, b.fy) ||
      differ(a.cx, b.cx) || differ(a.cy, b.cy) || differ(a.baseline, b.baseline)) {
    throw InputError(name + ": was made with another calibration");
  }
  if (map.scales().extractor != other.scales().extractor) {
    throw InputError(name + ": was made with features of '" + other.scales().extractor +
                     "', the other map with those of '" + map.scales().extractor + "'");
  }
  if (!map.scales().same_levels(other.scales())) {
    throw InputError(name + ": was made with other pyramid levels (orb.levels, orb.scale_factor)");
  }
  for (const double x : {0.1, 0.5, 0.9}) {
    for (const double y : {0.1, 0.5, 0.9}) {
      const auto u = static_cast<float>(x * a.width), v = static_cast<float>(y * a.height);
      const RigCorrection::Measured measured{u, v, u - 0.02F * static_cast<float>(a.width),
                                             std::nanf("")};
      const RigCorrection::Ideal one = map.rig().pair(measured), two = other.rig().pair(measured);
      const double off = std::max({std::abs(one.u - two.u), std::abs(one.v - two.v),
                                   std::abs((one.u - one.u_right) - (two.u - two.u_right))});
      if (off > kSameRig) {
        throw InputError(name + ": has another correction of the cameras: they differ by " +
                         std::to_string(off) + " px");
      }
    }
  }
}

kys::Prior with_instance(kys::Prior prior, std::int32_t by) {
  if (prior.instance < 0) return prior;
  if (prior.instance % kys::kRightInstances >= kys::kRightInstances - by) {
    throw InputError("two maps have too many instances together");
  }
  prior.instance += by;
  return prior;
}

std::int32_t instances_of(const MapContents& contents) {
  std::int32_t end = 0;
  const auto see = [&](const kys::Prior& prior) {
    if (prior.instance >= 0) end = std::max(end, prior.instance % kys::kRightInstances + 1);
  };
  for (const KeyFrame& k : contents.keyframes) {
    for (const kys::Prior& prior : k.features->priors()) see(prior);
  }
  for (const Landmark& l : contents.landmarks) see(l.prior);
  return end;
}

/// Moves ids, frames and instances of `more` behind those of `contents`, and adds it.
void append(MapContents& contents, MapContents more) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max();
  if (std::uint64_t{contents.keyframe_id_end} + more.keyframe_id_end >= kMost ||
      std::uint64_t{contents.landmark_id_end} + more.landmark_id_end >= kMost) {
    throw InputError("two maps have too many ids together");
  }
  const std::uint32_t keyframes = contents.keyframe_id_end, landmarks = contents.landmark_id_end;
  const std::int32_t instances = instances_of(contents);
  std::int64_t frames = 0;
  for (const KeyFrame& k : contents.keyframes) frames = std::max(frames, k.frame_index + 1);
  const auto keyframe = [&](KeyFrameId id) {
    return id.valid() ? KeyFrameId{id.value + keyframes} : id;
  };
  for (KeyFrame& k : more.keyframes) {
    k.id = keyframe(k.id);
    k.submap = keyframe(k.submap);
    k.parent = keyframe(k.parent);
    k.frame_index =
        std::min(k.frame_index, std::numeric_limits<std::int64_t>::max() - frames) + frames;
    for (KeyFrameId& other : k.loop_edges) other = keyframe(other);
    std::vector<kys::Prior> priors;
    for (const kys::Prior& p : k.features->priors()) priors.push_back(with_instance(p, instances));
    if (!priors.empty()) {
      k.features =
          std::make_shared<const FrameFeatures>(k.features->with_priors(std::move(priors)));
    }
    contents.keyframes.push_back(std::move(k));
  }
  for (CulledKeyFrame& c : more.culled) {
    contents.culled.push_back({keyframe(c.id), keyframe(c.parent), c.T_c_parent});
  }
  for (Landmark& l : more.landmarks) {
    l.id = {l.id.value + landmarks};
    l.reference = keyframe(l.reference);
    l.first_keyframe = keyframe(l.first_keyframe);
    l.prior = with_instance(l.prior, instances);
    for (Observation& o : l.observations) o.keyframe = keyframe(o.keyframe);
    contents.landmarks.push_back(std::move(l));
  }
  contents.keyframe_id_end += more.keyframe_id_end;
  contents.landmark_id_end += more.landmark_id_end;
}

}  // namespace

MergeReport merge_map(Map& map, const Map& other, const std::string& name,
                      const std::atomic<bool>* stop) {
  check_same_rig(map, other, name);
  if (map.keeps_beliefs() != other.keeps_beliefs()) {
    throw InputError(name + ": one of the maps has beliefs (mode verified), the other has none");
  }
  Map theirs(other.contents());
  theirs.set_rig(map.rig_estimate());
  MapContents contents = map.contents();
  const KeyFrameId ours_end{contents.keyframe_id_end};
  append(contents, theirs.contents());
  Map both(std::move(contents));

  const kys::DistanceModel model;  // descriptors alone: classes differ between recordings
  LoopOptions options;
  options.candidates = 5;  // some are of the keyframe's own map
  options.min_gap = 1;
  make_strict(map.scales().distances, options);
  LoopCloser closer(options, {}, model);
  PlaceIndex places(strict_places(map.scales().distances));
  places.apply(both.take_changes());
  MergeReport report;
  for (const KeyFrameId id : both.keyframes().ids()) {
    if (id < ours_end || (stop != nullptr && *stop)) continue;
    const LoopReport loop = closer.process(both, id, places, stop);
    ++report.keyframes;
    report.candidates += loop.candidates;
    if (!loop.closed) continue;
    report.fused += loop.fused;
    report.places.push_back({id.value, loop.closed->value, loop.merged, loop.gap});
    report.merged = report.merged || (loop.merged && *loop.closed < ours_end);
    places.apply(both.take_changes());
  }
  if (report.merged) map = std::move(both);
  return report;
}

}  // namespace kys_slam
