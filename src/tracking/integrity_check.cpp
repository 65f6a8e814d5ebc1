// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/integrity_check.h"

#include <algorithm>

#include "geometry/image_cells.h"
#include "tracking/passing_cells.h"
#include "tracking/scene_support.h"

namespace kys_slam {

const char* to_string(Integrity integrity) {
  switch (integrity) {
    case Integrity::kDegraded:
      return "degraded";
    case Integrity::kContradicted:
      return "contradicted";
    case Integrity::kOk:
      break;
  }
  return "ok";
}

const char* to_string(IntegrityReason reason) {
  switch (reason) {
    case IntegrityReason::kImpossibleMotion:
      return "the motion needs an impossible acceleration";
    case IntegrityReason::kTwoMotions:
      return "a large part of the image moves otherwise";
    case IntegrityReason::kOnlyObjects:
      return "only objects that can move support the pose";
    case IntegrityReason::kWeakGeometry:
      return "few or far points leave the position uncertain";
    case IntegrityReason::kFewPoints:
      return "few landmarks support the pose";
    case IntegrityReason::kManyOutliers:
      return "most matches disagree with the pose";
    case IntegrityReason::kHeld:
      return "held by constant velocity";
    case IntegrityReason::kNone:
      break;
  }
  return "";
}

void describe(kys::OptionList& list, IntegrityOptions& o) {
  list.add("integrity.enabled", o.enabled, "poses are checked for degraded and contradicted ones");
  list.add("integrity.max_sigma", o.max_sigma, {0, 1e6}, "m",
           "standard deviation of the position against the map above which a pose is degraded");
  list.add("integrity.min_inliers", o.min_inliers, {0, 60000}, "",
           "landmarks below which a pose is degraded");
  list.add("integrity.min_share", o.min_share, {0, 1}, "",
           "share of inliers in the matches below which a pose is degraded");
  list.add("integrity.outlier_area", o.unexplained, {0, 1}, "",
           "share of the image area without inliers from which another motion is searched");
  list.add("integrity.other_motion_area", o.other_area, {0, 1000}, "",
           "image area of another motion, as a part of that of the pose, that contradicts it");
  list.add("integrity.other_motion_area_behind", o.other_area_behind, {0, 1000}, "",
           "the same when it is of what lies behind: objects move in front of the scene");
  list.add("integrity.points", o.points, {3, 60000}, "",
           "points of the last frame in which another motion is searched");
  list.add("integrity.samples", o.samples, {1, 100000}, "",
           "samples of three points in this search");
  list.add("integrity.seed", o.seed, {0, 1e9}, "", "seed of these samples");
  list.add("integrity.min_matches", o.min_matches, {3, 60000}, "",
           "points that another motion has to fit");
  list.add("integrity.min_cells", o.min_cells, {1, 1000}, "",
           "cells of the image in which they have to lie");
  list.add("integrity.max_still_shift", o.still, {0, 1000}, "px",
           "mean shift in the image up to which something keeps its place");
  list.add("integrity.still_frames", o.still_frames, {1, 1e6}, "frames",
           "in which something keeps its place while the camera moves, until a warning names it "
           "and it takes "
           "no part any more");
  list.add("integrity.passing_frames", o.passing, {1, 24}, "frames",
           "in which a cell of the image flows by, while the camera stands by its poses, until it "
           "counts as another motion");
  list.add("integrity.passing_window", o.passing_window, {1, 24}, "frames",
           "the last ones, in which these are counted");
}

namespace {

/// Whether what moves otherwise speaks against the pose. Objects move in front of the scene: a
/// small area is enough when it lies behind what the pose explains, or when nothing says that it is
/// in front and the pose says that the camera stands.
bool contradicts(const OtherMotion& other, const IntegrityOptions& o) {
  constexpr int kLead = 2;     // cells
  constexpr double kFlow = 4;  // times the shift that the pose predicts
  if (other.cells.empty()) return false;
  const bool lies_behind = other.order.behind - other.order.in_front >= kLead;
  const bool flows_by = other.order.in_front <= other.order.behind &&
                        other.shift > kFlow * o.still && other.shift > kFlow * other.pose_shift;
  const double least = lies_behind || flows_by ? o.other_area_behind : o.other_area;
  return static_cast<double>(other.cells.size()) >= least * other.explained;
}

}  // namespace

/// Reasons in the order of their weight; the first one stands. No pose changes by them: a rule that
/// rejects a pose has to be right nearly always (PoseJudge), a flag for a filter may be wrong now
/// and then (docs/pose_quality.md).
IntegrityResult IntegrityCheck::check(const TrackingContext& c, const TrackedFrame& frame,
                                      const Evidence& evidence, bool jumped, bool follows,
                                      kys::Statistics& statistics) {
  const IntegrityOptions& o = c.options.integrity;
  IntegrityResult result;
  if (!o.enabled) return result;
  const auto flag = [&](Integrity integrity, IntegrityReason reason) {
    if (result.integrity == Integrity::kOk) {
      result.integrity = integrity;
      result.reason = reason;
    }
  };
  if (jumped) flag(Integrity::kContradicted, IntegrityReason::kImpossibleMotion);
  if (follows) {
    const OtherMotion other = find_other_motion(c, frame, known_, statistics);
    remember_still(c, other);
    const std::size_t passing = remember_passing(c, frame, statistics);
    const bool passes =
        passing > 0 && static_cast<double>(passing) >= o.other_area_behind * other.explained;
    if (contradicts(other, o) || passes) {
      flag(Integrity::kContradicted, IntegrityReason::kTwoMotions);
    }
  } else {
    passing_.clear();
  }
  result.keeps_place = has_still();
  if (c.beliefs.in_use()) {
    const SceneSupport seen = scene_in_view(c, *frame.features, frame.landmarks);
    if (seen.on_objects > 0 && !seen.is_in_view(c.options.judge.support)) {
      flag(Integrity::kDegraded, IntegrityReason::kOnlyObjects);
    }
  }
  if (!(evidence.position_sigma <= o.max_sigma)) {
    flag(Integrity::kDegraded, IntegrityReason::kWeakGeometry);
  }
  if (evidence.inliers < o.min_inliers) {
    flag(Integrity::kDegraded, IntegrityReason::kFewPoints);
  }
  if (evidence.inliers < o.min_share * evidence.matches) {
    flag(Integrity::kDegraded, IntegrityReason::kManyOutliers);
  }
  if (frame.held) flag(Integrity::kDegraded, IntegrityReason::kHeld);
  return result;
}

/// The own bonnet, a sticker on the lens or a vehicle at the camera's pace: what they have in
/// common is a place in the image. A cell counts up while it stays and down otherwise, so that a
/// single wrong search changes nothing. Cells in which something keeps its place, frame after
/// frame, while the camera moves.
void IntegrityCheck::remember_still(const TrackingContext& c, const OtherMotion& other) {
  const IntegrityOptions& o = c.options.integrity;
  const std::size_t size = ImageCells(c.camera, kAreaColumns).size();
  still_.resize(size);
  known_.resize(size);
  const bool still =
      !other.cells.empty() && other.shift <= o.still && other.pose_shift > 3 * o.still;
  for (std::size_t cell = 0; cell < size; ++cell) {
    const bool here = still && std::ranges::binary_search(other.cells, cell);
    still_[cell] = std::max(0, still_[cell] + (here ? 1 : -1));
    if (still_[cell] >= o.still_frames) known_[cell] = 1;
  }
}

/// A few corners in a frame are weak evidence, the same cells in several frames are not: how many
/// cells flow by a camera that stands by its poses.
std::size_t IntegrityCheck::remember_passing(const TrackingContext& c, const TrackedFrame& frame,
                                             kys::Statistics& statistics) {
  const IntegrityOptions& o = c.options.integrity;
  const ImageCells cells(c.camera, kAreaColumns);
  passing_.push_back(find_passing_cells(c, frame, known_, statistics));
  while (passing_.size() > static_cast<std::size_t>(o.passing_window)) passing_.pop_front();
  std::vector<int> frames(cells.size());
  for (const std::vector<std::size_t>& passed : passing_) {
    for (const std::size_t cell : passed) ++frames[cell];
  }
  return static_cast<std::size_t>(
      std::ranges::count_if(frames, [&](int count) { return count >= o.passing; }));
}

bool IntegrityCheck::has_still() const {
  return std::ranges::any_of(known_, [](std::uint8_t k) { return k != 0; });
}

}  // namespace kys_slam
