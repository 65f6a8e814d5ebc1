// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/loop_closer.h"

#include <kys/portable_math.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "geometry/camera_path.h"

namespace kys_slam {

void describe(kys::OptionList& list, LoopOptions& o) {
  list.add("loop.enabled", o.enabled, "close loops and merge sub-maps");
  list.add("loop.min_gap", o.min_gap, {0, 1e9}, "keyframes", "between two loops");
  list.add("loop.candidates", o.candidates, {0, 100}, "", "places verified per keyframe");
  list.add("loop.min_votes", o.min_votes, {0, 60000}, "",
           "votes of features below which a place is skipped");
  list.add("loop.neighbours", o.neighbours, {0, 1000}, "",
           "covisible keyframes tested for confirmation");
  list.add("loop.min_confirming", o.min_confirming, {0, 1000}, "",
           "number of these that must confirm");
  list.add("loop.min_neighbour_inliers", o.min_neighbour_inliers, {0, 60000}, "",
           "landmarks of the place that each of them must match");
  list.add("loop.max_neighbour_shift", o.max_neighbour_shift, {0, 1000}, "m, and m/m",
           "between the verified and the expected position of one: this much plus this share of "
           "its distance");
  list.add("loop.max_neighbour_turn", o.max_neighbour_turn, {0, 180}, "deg",
           "between the verified and the expected orientation of one");
  list.add("loop.max_drift", o.max_drift, {0, 1e6}, "",
           "largest error of the path since the place as a share of its length");
  list.add("loop.min_allowed_drift", o.min_allowed_drift, {0, 1e6}, "m",
           "error allowed for short paths too");
  list.add("loop.essential_weight", o.essential_weight, {1, 1e6}, "",
           "shared landmarks of an edge of the essential graph");
  list.add("loop.graph_iterations", o.graph_iterations, {0, 1000}, "",
           "largest number of iterations of the pose graph");
  describe(list, o.joint);
  const kys::OptionList::Fixed fixed(list);
  describe(list, o.verification);  // set as place.*
  describe(list, o.fusion, "loop.");
}

namespace {

double degrees(const Rigid3& T) {
  const double half = kys::portable::atan2(T.rotation.vec().norm(), std::abs(T.rotation.w()));
  return 2 * half * 180 / std::numbers::pi;
}

/// From the pose of `current` in the map to its pose as verified.
Rigid3 gap_of(const Map& map, KeyFrameId current, const VerifiedPlace& place) {
  return place.T_c_w * map.keyframe(current).T_c_w.inverse();
}

/// Keyframes that share landmarks with `current`, or with one that does: no loop leads to them.
std::vector<KeyFrameId> covisibility_neighbourhood(const Map& map, KeyFrameId current) {
  std::vector<KeyFrameId> near{current};
  for (const Covisible& c : map.keyframe(current).covisible) {
    near.push_back(c.keyframe);
    for (const Covisible& second : map.keyframe(c.keyframe).covisible) {
      near.push_back(second.keyframe);
    }
  }
  std::sort(near.begin(), near.end());
  near.erase(std::unique(near.begin(), near.end()), near.end());
  return near;
}

}  // namespace

/// For `min_gap` keyframes after a loop none is searched within the sub-map: they see the place
/// that has just been joined, and its correction is not adjusted yet (FullBundle). Sub-maps are
/// joined where no loop is found: one keyframe that is verified alone is the stronger evidence.
LoopReport LoopCloser::process(Map& map, KeyFrameId current, const PlaceIndex& index,
                               const std::atomic<bool>* stop) {
  LoopReport report;
  if (!options_.enabled || !map.has(current)) return report;
  const bool rests =
      last_closed_ && current.value < last_closed_->value + static_cast<unsigned>(options_.min_gap);
  std::optional<Confirmed> loop;
  if (!rests) loop = detect(map, current, index, report);
  if (!loop) loop = detect_joint(map, current, index, report);
  if (loop) apply(map, current, *loop, report, stop);
  return report;
}

LoopReport LoopCloser::join(Map& map, KeyFrameId current, const PlaceIndex& index,
                            const std::atomic<bool>* stop) {
  LoopReport report;
  if (!options_.enabled || !map.has(current)) return report;
  const std::optional<Confirmed> loop = detect_joint(map, current, index, report);
  if (loop) apply(map, current, *loop, report, stop);
  return report;
}

LoopReport LoopCloser::join_at(Map& map, const FrameFeatures& features, const VerifiedPlace& there,
                               KeyFrameId current, const std::atomic<bool>* stop) {
  LoopReport report;
  if (!options_.enabled || !map.has(current) || !map.has(there.keyframe)) return report;
  const PlaceVerificationOptions& v = options_.verification;
  const std::optional<VerifiedPlace> here =
      verify_place(map, features, current, v, *model_, report.statistics);
  if (!here) return report;
  const Rigid3 T_current_there = map.keyframe(current).T_c_w * here->T_c_w.inverse() * there.T_c_w;
  Confirmed loop;
  loop.place = match_place(map, *map.keyframe(current).features, T_current_there,
                           landmarks_around(map, there.keyframe, v.window), v.narrow_radius,
                           v.search_distance, *model_, report.statistics);
  loop.place.T_c_w = T_current_there;  // it may see little of the place itself
  loop.place.keyframe = there.keyframe;
  apply(map, current, loop, report, stop);
  return report;
}

void LoopCloser::apply(Map& map, KeyFrameId current, const Confirmed& loop, LoopReport& report,
                       const std::atomic<bool>* stop) {
  Stopwatch watch;
  const Rigid3 gap = gap_of(map, current, loop.place);
  report.closed = loop.place.keyframe;
  report.distance =
      (map.keyframe(loop.place.keyframe).T_c_w * loop.place.T_c_w.inverse()).translation.norm();
  report.closed_frame = map.keyframe(loop.place.keyframe).frame_index;
  report.merged = map.keyframe(current).submap != map.keyframe(loop.place.keyframe).submap;
  if (report.merged) {
    merge(map, current, loop);
  } else {
    report.gap = gap.translation.norm();
    report.gap_deg = degrees(gap);
    close(map, current, loop, stop);
  }
  report.fused = fuse(map, current, loop, report);
  adjust_locally(map, current, bundle_, stop);
  last_closed_ = current;
  report.correct = watch.lap_ms();
}

/// The best joint with another sub-map. Their places are requested apart from those of the own
/// one, which would take the first ranks.
std::optional<LoopCloser::Confirmed> LoopCloser::detect_joint(const Map& map, KeyFrameId current,
                                                              const PlaceIndex& index,
                                                              LoopReport& report) const {
  if (!options_.joint.enabled) return std::nullopt;
  const std::vector<KeyFrameId> own = map.submap_keyframes(map.keyframe(current).submap);
  if (own.size() == map.keyframes().size()) return std::nullopt;
  Stopwatch watch;
  const std::vector<PlaceCandidate> candidates = index.query(
      *map.keyframe(current).features, *model_, report.statistics, own, options_.joint.candidates);
  report.query += watch.lap_ms();
  std::optional<Joint> best;
  for (const PlaceCandidate& candidate : candidates) {
    if (!map.has(candidate.keyframe)) continue;
    ++report.candidates;
    std::optional<Joint> joint = find_joint(map, current, candidate.keyframe, options_.joint,
                                            options_.verification, *model_, report.statistics);
    if (joint && (!best || joint->total > best->total)) best = std::move(joint);
  }
  report.verify += watch.lap_ms();
  if (!best) return std::nullopt;
  return Confirmed{std::move(best->place), std::move(best->neighbours)};
}

/// The confirmed place with most inliers. Each test costs more than the one before it and sees
/// fewer places: votes, geometry of one keyframe, length of the path, geometry of its neighbours
/// (ORB-SLAM, Sec. VII-A and B, with covisibility in place of consecutive keyframes).
std::optional<LoopCloser::Confirmed> LoopCloser::detect(const Map& map, KeyFrameId current,
                                                        const PlaceIndex& index,
                                                        LoopReport& report) const {
  Stopwatch watch;
  const FrameFeatures& features = *map.keyframe(current).features;
  const std::vector<PlaceCandidate> candidates =
      index.query(features, *model_, report.statistics, covisibility_neighbourhood(map, current),
                  options_.candidates);
  report.query = watch.lap_ms();
  std::optional<Confirmed> best;
  for (const PlaceCandidate& candidate : candidates) {
    if (!map.has(candidate.keyframe) || candidate.votes < options_.min_votes) continue;
    ++report.candidates;
    std::optional<VerifiedPlace> place = verify_place(
        map, features, candidate.keyframe, options_.verification, *model_, report.statistics);
    if (!place || (best && place->inliers <= best->place.inliers)) continue;
    if (!is_plausible(map, current, *place)) continue;
    std::optional<Confirmed> confirmed =
        confirm(map, current, std::move(*place), report.statistics);
    if (confirmed) best = std::move(confirmed);
  }
  report.verify = watch.lap_ms();
  return best;
}

/// Whether odometry can be as wrong as a loop says. Two equal facades, or a truck followed through
/// two streets, verify as one place; the correction then is a large part of the path, true ones are
/// far below 2 % (README). Two sub-maps may lie anywhere.
bool LoopCloser::is_plausible(const Map& map, KeyFrameId current,
                              const VerifiedPlace& place) const {
  const KeyFrameId submap = map.keyframe(current).submap;
  if (map.keyframe(place.keyframe).submap != submap) return true;
  std::vector<Rigid3> since;
  for (const KeyFrameId id : map.submap_keyframes(submap)) {
    if (place.keyframe <= id && id <= current) since.push_back(map.keyframe(id).T_c_w);
  }
  const double allowed =
      options_.max_drift * camera_path_length(since) + options_.min_allowed_drift;
  return gap_of(map, current, place).translation.norm() <= allowed;
}

/// Covisible keyframes of the current one have to see the place from where they are relative to it:
/// a facade or a car like another is not followed by the same street.
std::optional<LoopCloser::Confirmed> LoopCloser::confirm(const Map& map, KeyFrameId current,
                                                         VerifiedPlace place,
                                                         kys::Statistics& statistics) const {
  const PlaceVerificationOptions& v = options_.verification;
  Confirmed confirmed{std::move(place), {}};
  const std::vector<LandmarkId> around =
      landmarks_around(map, confirmed.place.keyframe, 2 * v.window);
  for (const KeyFrameId id : map.best_covisible(current, options_.neighbours)) {
    const std::optional<VerifiedPlace> seen = match_neighbour(
        map, current, confirmed.place.T_c_w, id, around, v, options_.max_neighbour_shift,
        options_.max_neighbour_turn, *model_, statistics);
    if (!seen || seen->inliers < options_.min_neighbour_inliers) continue;
    if (seen->inliers < v.min_share * seen->in_view) continue;
    confirmed.neighbours.push_back(id);
  }
  if (static_cast<int>(confirmed.neighbours.size()) < options_.min_confirming) return std::nullopt;
  return confirmed;
}

/// Spreads the gap over the essential graph: spanning tree, strong covisibility, loop edges
/// (ORB-SLAM, Sec. VII-D).
void LoopCloser::close(Map& map, KeyFrameId current, const Confirmed& loop,
                       const std::atomic<bool>* stop) const {
  const KeyFrameId submap = map.keyframe(current).submap;
  const std::vector<KeyFrameId> ids = map.submap_keyframes(submap);
  const auto index_of = [&](KeyFrameId id) {
    return static_cast<std::int32_t>(std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
  };
  std::vector<Rigid3> T_w_c;
  std::vector<std::uint8_t> fixed;
  std::vector<PoseGraphEdge> edges;
  const auto add_edge = [&](KeyFrameId a, KeyFrameId b) {
    edges.push_back(
        {index_of(a), index_of(b), map.keyframe(a).T_c_w * map.keyframe(b).T_c_w.inverse()});
  };
  for (const KeyFrameId id : ids) {
    const KeyFrame& keyframe = map.keyframe(id);
    T_w_c.push_back(keyframe.T_c_w.inverse());
    fixed.push_back(keyframe.parent.valid() ? 0 : 1);
    if (keyframe.parent.valid()) add_edge(keyframe.parent, id);
    for (const KeyFrameId other : keyframe.loop_edges) {
      if (other < id) add_edge(other, id);
    }
    for (const Covisible& c : keyframe.covisible) {
      if (c.keyframe >= id || c.weight < options_.essential_weight) continue;
      if (c.keyframe == keyframe.parent || map.keyframe(c.keyframe).parent == id) continue;
      add_edge(c.keyframe, id);
    }
  }
  // The loop itself: the current keyframe and those that confirmed it, as seen from the place.
  const KeyFrameId place = loop.place.keyframe;
  const Rigid3& T_p_w = map.keyframe(place).T_c_w;
  const Rigid3 T_w_current = map.keyframe(current).T_c_w.inverse();
  std::vector<KeyFrameId> here = loop.neighbours;
  here.push_back(current);
  for (const KeyFrameId id : here) {
    const Rigid3 corrected = map.keyframe(id).T_c_w * T_w_current * loop.place.T_c_w;
    edges.push_back({index_of(place), index_of(id), T_p_w * corrected.inverse()});
  }
  optimize_pose_graph(T_w_c, fixed, edges, {options_.graph_iterations, stop});
  std::vector<Rigid3> T_c_w;
  T_c_w.reserve(T_w_c.size());
  for (const Rigid3& T : T_w_c) T_c_w.push_back(T.inverse());
  map.move_keyframes(ids, T_c_w);
  map.add_loop_edge(place, current);
}

/// The younger of two sub-maps moves into the frame of the older one, whose world frame stays as
/// it is.
void LoopCloser::merge(Map& map, KeyFrameId current, const Confirmed& loop) const {
  const KeyFrameId place = loop.place.keyframe;
  const KeyFrameId ours = map.keyframe(current).submap;
  const KeyFrameId theirs = map.keyframe(place).submap;
  Rigid3 T_their_our = loop.place.T_c_w.inverse() * map.keyframe(current).T_c_w;
  const bool we_move = theirs < ours;
  if (!we_move) T_their_our = T_their_our.inverse();
  const std::vector<KeyFrameId> moving = map.submap_keyframes(we_move ? ours : theirs);
  const Rigid3 T_old_new = T_their_our.inverse();
  std::vector<Rigid3> T_c_w;
  T_c_w.reserve(moving.size());
  for (const KeyFrameId id : moving) T_c_w.push_back(map.keyframe(id).T_c_w * T_old_new);
  map.move_keyframes(moving, T_c_w);
  map.join_submaps(we_move ? current : place, we_move ? place : current);
  map.add_loop_edge(place, current);
}

/// Landmarks of the place and of the keyframes here become one where they are the same.
int LoopCloser::fuse(Map& map, KeyFrameId current, const Confirmed& loop,
                     LoopReport& report) const {
  int fused = 0;
  for (std::size_t f = 0; f < loop.place.landmarks.size(); ++f) {
    const LandmarkId theirs = map.resolve(loop.place.landmarks[f]);
    if (!theirs.valid()) continue;
    const LandmarkId ours = map.keyframe(current).landmarks[f];
    if (ours == theirs) continue;
    if (ours.valid()) {
      map.replace_landmark(ours, theirs);
    } else if (map.add_observation(theirs, current, static_cast<std::uint32_t>(f))) {
      map.refresh_landmark(theirs);
    } else {
      continue;
    }
    ++fused;
  }
  const KeyFrameId place = loop.place.keyframe;
  std::vector<KeyFrameId> here = map.best_covisible(current, options_.fusion.neighbours);
  here.push_back(current);
  std::sort(here.begin(), here.end());
  const std::vector<LandmarkId> there = landmarks_around(map, place, options_.verification.window);
  for (const KeyFrameId id : here) {
    fused += fuse_into(map, id, there, options_.fusion, *model_, report.statistics);
  }
  const std::vector<LandmarkId> ours = landmarks_around(map, current, options_.fusion.neighbours);
  std::vector<KeyFrameId> theirs = map.best_covisible(place, options_.fusion.neighbours);
  theirs.push_back(place);
  std::sort(theirs.begin(), theirs.end());
  for (const KeyFrameId id : theirs) {
    fused += fuse_into(map, id, ours, options_.fusion, *model_, report.statistics);
  }
  return fused;
}

}  // namespace kys_slam
