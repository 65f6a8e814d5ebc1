// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/submap_joint.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace kys_slam {

void describe(kys::OptionList& list, JointOptions& o) {
  list.add("joint.enabled", o.enabled, "join sub-maps by several keyframes together");
  list.add("joint.candidates", o.candidates, {0, 100}, "",
           "places of other sub-maps tried per keyframe");
  list.add("joint.min_matches", o.min_matches, {3, 60000}, "",
           "matches without prediction below which no alignment is tried");
  list.add("joint.min_aligned", o.min_aligned, {3, 60000}, "",
           "inliers of the alignment below which the place is rejected");
  list.add("joint.neighbours", o.neighbours, {0, 1000}, "",
           "covisible keyframes compared besides the keyframe");
  list.add("joint.min_inliers", o.min_inliers, {3, 60000}, "",
           "landmarks that a keyframe must match to count");
  list.add("joint.min_share", o.min_share, {0, 1}, "", "... as a share of those it has in view");
  list.add("joint.min_keyframes", o.min_keyframes, {1, 1000}, "", "keyframes that count");
  list.add("joint.min_total", o.min_total, {1, 1e6}, "",
           "landmarks matched by them, each counted once per keyframe");
  list.add("joint.min_landmarks", o.min_landmarks, {1, 1e6}, "", "different ones among them");
  list.add("joint.min_area", o.min_area, {0, 1}, "",
           "mean share of the image area with landmarks in view that has matches");
  list.add("joint.max_shift", o.max_shift, {0, 1000}, "m, and m/m",
           "between the matched and the expected position of one of them");
  list.add("joint.max_turn", o.max_turn, {0, 180}, "deg",
           "between the matched and the expected orientation of one of them");
}

namespace {

double turn_of(const Rigid3& T) {
  const double half = kys::portable::atan2(T.rotation.vec().norm(), std::abs(T.rotation.w()));
  return 2 * half * 180 / std::numbers::pi;
}

/// With what a first pose is found; what it is worth is decided by all keyframes together.
PlaceVerificationOptions permissive(PlaceVerificationOptions v, const JointOptions& o) {
  v.min_descriptor_matches = o.min_matches;
  v.min_aligned = o.min_aligned;
  v.min_inliers = o.min_inliers;
  v.min_share = 0;
  v.min_area = 0;
  v.min_observers = 0;
  return v;
}

/// What keyframes that count have matched together.
struct Evidence {
  std::vector<LandmarkId> landmarks;  // with repetitions
  int keyframes = 0;
  double area = 0;  // sum

  /// A keyframe counts only with enough inliers of its own: chance matches of many keyframes do not
  /// add up to a place.
  bool add(const VerifiedPlace& seen, const JointOptions& o) {
    if (seen.inliers < o.min_inliers || seen.inliers < o.min_share * seen.in_view) return false;
    for (const LandmarkId id : seen.landmarks) {
      if (id.valid()) landmarks.push_back(id);
    }
    ++keyframes;
    area += seen.area;
    return true;
  }
  [[nodiscard]] int total() const { return static_cast<int>(landmarks.size()); }
  /// Different landmarks are counted as well: keyframes that stand close together match the same
  /// few again and again.
  [[nodiscard]] bool is_enough(const JointOptions& o) const {
    if (keyframes < o.min_keyframes || total() < o.min_total) return false;
    if (area < o.min_area * keyframes) return false;
    std::vector<LandmarkId> different = landmarks;
    std::sort(different.begin(), different.end());
    const auto end = std::unique(different.begin(), different.end());
    return end - different.begin() >= o.min_landmarks;
  }
};

}  // namespace

std::optional<VerifiedPlace> match_neighbour(const Map& map, KeyFrameId current,
                                             const Rigid3& T_current_place, KeyFrameId neighbour,
                                             const std::vector<LandmarkId>& around,
                                             const PlaceVerificationOptions& options,
                                             double max_shift, double max_turn,
                                             const kys::DistanceModel& model,
                                             kys::Statistics& statistics) {
  const KeyFrame& keyframe = map.keyframe(neighbour);
  const Rigid3 T_n_current = keyframe.T_c_w * map.keyframe(current).T_c_w.inverse();
  const Rigid3 expected = T_n_current * T_current_place;
  VerifiedPlace seen =
      match_place(map, *keyframe.features, expected, around, 1.5f * options.narrow_radius,
                  options.search_distance, model, statistics);
  const Rigid3 off = seen.T_c_w * expected.inverse();
  const double allowed = max_shift * (1 + T_n_current.translation.norm());
  if (off.translation.norm() > allowed || turn_of(off) > max_turn) return std::nullopt;
  return seen;
}

/// After a gap two sub-maps often see one place from other sides, and no single keyframe matches
/// enough of it. Several keyframes whose relative poses are known are one rigid observer with more
/// landmarks. The single one may be weak; what all have together must be as strong as a loop, over
/// different landmarks and enough area.
std::optional<Joint> find_joint(const Map& map, KeyFrameId current, KeyFrameId place,
                                const JointOptions& options,
                                const PlaceVerificationOptions& verification,
                                const kys::DistanceModel& model, kys::Statistics& statistics) {
  std::optional<VerifiedPlace> first =
      verify_place(map, *map.keyframe(current).features, place, permissive(verification, options),
                   model, statistics);
  if (!first) return std::nullopt;
  Joint joint;
  joint.place = std::move(*first);
  Evidence evidence;
  if (!evidence.add(joint.place, options)) return std::nullopt;
  const std::vector<LandmarkId> around = landmarks_around(map, place, 2 * verification.window);
  for (const KeyFrameId id : map.best_covisible(current, options.neighbours)) {
    const std::optional<VerifiedPlace> seen =
        match_neighbour(map, current, joint.place.T_c_w, id, around, verification,
                        options.max_shift, options.max_turn, model, statistics);
    if (seen && evidence.add(*seen, options)) joint.neighbours.push_back(id);
  }
  if (!evidence.is_enough(options)) return std::nullopt;
  joint.total = evidence.total();
  return joint;
}

}  // namespace kys_slam
