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

LoopReport LoopCloser::process(Map& map, KeyFrameId current, const PlaceIndex& index,
                               const std::atomic<bool>* stop) {
  LoopReport report;
  if (!options_.enabled || !map.has(current)) return report;
  if (last_closed_ &&
      current.value < last_closed_->value + static_cast<unsigned>(options_.min_gap)) {
    return report;
  }
  const std::optional<Confirmed> loop = detect(map, current, index, report);
  if (!loop) return report;
  Stopwatch watch;
  const Rigid3 gap = gap_of(map, current, loop->place);
  report.closed = loop->place.keyframe;
  report.distance =
      (map.keyframe(loop->place.keyframe).T_c_w * loop->place.T_c_w.inverse()).translation.norm();
  report.closed_frame = map.keyframe(loop->place.keyframe).frame_index;
  report.merged = map.keyframe(current).submap != map.keyframe(loop->place.keyframe).submap;
  if (report.merged) {
    merge(map, current, *loop);
  } else {
    report.gap = gap.translation.norm();
    report.gap_deg = degrees(gap);
    close(map, current, *loop, stop);
  }
  report.fused = fuse(map, current, *loop, report);
  adjust_locally(map, current, bundle_, stop);
  last_closed_ = current;
  report.correct = watch.lap_ms();
  return report;
}

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

/// Whether odometry can be as wrong as a loop says. Two sub-maps may lie anywhere.
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
  const Rigid3 T_w_current = map.keyframe(current).T_c_w.inverse();
  for (const KeyFrameId id : map.best_covisible(current, options_.neighbours)) {
    const KeyFrame& neighbour = map.keyframe(id);
    const Rigid3 T_n_current = neighbour.T_c_w * T_w_current;
    const Rigid3 expected = T_n_current * confirmed.place.T_c_w;
    const VerifiedPlace seen =
        match_place(map, *neighbour.features, expected, around, 1.5f * v.narrow_radius,
                    v.search_distance, *model_, statistics);
    if (seen.inliers < options_.min_neighbour_inliers) continue;
    if (seen.inliers < v.min_share * seen.in_view) continue;
    const Rigid3 off = seen.T_c_w * expected.inverse();
    const double allowed = options_.max_neighbour_shift * (1 + T_n_current.translation.norm());
    if (off.translation.norm() > allowed || degrees(off) > options_.max_neighbour_turn) continue;
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

/// The younger of two sub-maps moves into the frame of the older one.
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
