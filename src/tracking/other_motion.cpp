// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/other_motion.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "geometry/absolute_orientation.h"
#include "geometry/ransac.h"
#include "optimization/pose_optimization.h"
#include "tracking/open_cells.h"
#include "tracking/pose_estimation.h"

namespace kys_slam {
namespace {

constexpr double kReach = 2;  // factor on the error bound within which a match fits a motion

bool can_contradict(const TrackingContext& c, const FrameFeatures& features, std::size_t i) {
  return features.has_stereo(i) && c.beliefs.is_static(features.prior(i));
}

/// What contradicts a pose is area without inliers, not the number of outliers: repeated texture
/// gives outliers all over the image, another motion gives a region without inliers. Such points
/// are searched again by descriptor alone, since a search near the pose would find what agrees with
/// it. Points of the last frame in cells that the pose does not explain, a limited number, evenly.
std::vector<std::size_t> open_points(const TrackingContext& c, const ImageCells& cells,
                                     const CellCounts& counts) {
  const TrackedFrame& last = *c.last;
  std::vector<std::size_t> points;
  for (std::size_t i = 0; i < last.features->size(); ++i) {
    const Keypoint& k = last.features->keypoint(i);
    if (counts.is_open(cells.index(k.x, k.y)) && can_contradict(c, *last.features, i)) {
      points.push_back(i);
    }
  }
  return choose_evenly(std::move(points), static_cast<std::size_t>(c.options.integrity.points));
}

/// A point of the last frame that was found again.
struct PointMatch {
  std::size_t before = 0;       // feature of the last frame
  std::size_t now = 0;          // feature of this one
  Eigen::Vector3d p_now;        // m, camera frame now
  PoseObservation observation;  // of the point in the world, as the last pose puts it
};

std::vector<PointMatch> match_points(const TrackingContext& c, const TrackedFrame& frame,
                                     const std::vector<std::size_t>& points,
                                     kys::Statistics& statistics) {
  const FrameFeatures& before = *c.last->features;
  const FrameFeatures& now = *frame.features;
  const auto found = find_again(c, frame, points, statistics);
  const Rigid3 T_w_last = c.last->T_c_w.inverse();
  std::vector<PointMatch> matches;
  for (std::size_t q = 0; q < found.size(); ++q) {
    if (found[q] < 0 || !now.has_stereo(static_cast<std::size_t>(found[q]))) continue;
    PointMatch m{points[q], static_cast<std::size_t>(found[q]), {}, {}};
    const Keypoint& a = before.keypoint(m.before);
    const Keypoint& b = now.keypoint(m.now);
    m.p_now = c.camera.back_project(b.x, b.y, now.depth(m.now));
    const Eigen::Vector3d p_w = T_w_last * c.camera.back_project(a.x, a.y, before.depth(m.before));
    m.observation = observation_of(c, now, m.now, p_w, 1);
    matches.push_back(m);
  }
  return matches;
}

/// The matches, with their errors at many poses.
class MatchErrors {
 public:
  MatchErrors(const StereoCamera& camera, const std::vector<PointMatch>& matches)
      : matches_(&matches), errors_(camera, observations_of(matches), {}) {}

  /// How many fit a pose.
  [[nodiscard]] std::ptrdiff_t count_fitting(const Rigid3& T_c_w) {
    errors_.at(T_c_w, values_);
    return std::ranges::count_if(values_, &fits);
  }
  /// Those that fit a pose, or those that do not.
  [[nodiscard]] std::vector<PointMatch> select(const Rigid3& T_c_w, bool fitting) {
    errors_.at(T_c_w, values_);
    std::vector<PointMatch> selected;
    for (std::size_t k = 0; k < values_.size(); ++k) {
      if (fits(values_[k]) == fitting) selected.push_back((*matches_)[k]);
    }
    return selected;
  }
  [[nodiscard]] static std::vector<PoseObservation> observations_of(
      const std::vector<PointMatch>& matches) {
    std::vector<PoseObservation> observations;
    for (const PointMatch& m : matches) observations.push_back(m.observation);
    return observations;
  }

 private:
  static bool fits(double error) { return error <= kReach * kReach; }

  const std::vector<PointMatch>* matches_;
  PoseErrors errors_;
  std::vector<double> values_;
};

std::optional<Rigid3> pose_from(const std::vector<PointMatch>& matches) {
  std::vector<Eigen::Vector3d> p_c, p_w;
  for (const PointMatch& m : matches) {
    p_c.push_back(m.p_now);
    p_w.push_back(m.observation.p_w);
  }
  return absolute_orientation(p_c, p_w);
}

/// The matches that one rigid motion fits; the motion with most of them.
std::vector<PointMatch> common_motion(const TrackingContext& c,
                                      const std::vector<PointMatch>& matches) {
  MatchErrors errors(c.camera, matches);
  std::optional<Rigid3> best;
  std::ptrdiff_t most = 2;
  SampleGenerator<3> samples(matches.size(), c.options.integrity.seed);
  for (int k = 0; k < c.options.integrity.samples; ++k) {
    const auto sample = samples.next();
    const std::optional<Rigid3> T_c_w =
        pose_from({matches[sample[0]], matches[sample[1]], matches[sample[2]]});
    if (!T_c_w) continue;
    const std::ptrdiff_t fitting = errors.count_fitting(*T_c_w);
    if (fitting <= most) continue;
    most = fitting;
    best = T_c_w;
  }
  if (!best) return {};
  const std::vector<PointMatch> near = errors.select(*best, true);
  const std::optional<Rigid3> start = pose_from(near);
  if (!start) return {};
  const PoseResult refined = optimize_pose(c.camera, *start, MatchErrors::observations_of(near));
  return errors.select(refined.T_c_w, true);
}

}  // namespace

OtherMotion find_other_motion(const TrackingContext& c, const TrackedFrame& frame,
                              const std::vector<std::uint8_t>& ignored,
                              kys::Statistics& statistics) {
  const IntegrityOptions& o = c.options.integrity;
  const ImageCells cells(c.camera, kAreaColumns);
  const CellCounts counts = count_cells(c, frame, cells, ignored);
  OtherMotion result;
  result.explained = counts.explained();
  int open = 0;
  for (std::size_t cell = 0; cell < cells.size(); ++cell) {
    open += counts.is_open(cell) ? 1 : 0;
  }
  if (open < o.unexplained * (open + result.explained)) return result;
  const std::vector<PointMatch> matches =
      match_points(c, frame, open_points(c, cells, counts), statistics);
  const std::vector<PointMatch> others = MatchErrors(c.camera, matches).select(frame.T_c_w, false);
  const auto least = static_cast<std::size_t>(o.min_matches);
  if (others.size() < least) return result;
  const std::vector<PointMatch> common = common_motion(c, others);
  if (common.size() < least) return result;
  std::vector<std::size_t> there;
  for (const PointMatch& m : common) {
    there.push_back(m.now);
    const Keypoint& a = c.last->features->keypoint(m.before);
    const Keypoint& b = frame.features->keypoint(m.now);
    const Eigen::Vector3d p = c.camera.project_stereo(frame.T_c_w * m.observation.p_w);
    result.shift += kys::portable::hypot(b.x - a.x, b.y - a.y) / static_cast<double>(common.size());
    result.pose_shift += std::min(kys::portable::hypot(p.x() - a.x, p.y() - a.y), 1e3) /
                         static_cast<double>(common.size());
    result.cells.push_back(cells.index(b.x, b.y));
  }
  std::sort(result.cells.begin(), result.cells.end());
  result.cells.erase(std::unique(result.cells.begin(), result.cells.end()), result.cells.end());
  if (result.cells.size() < static_cast<std::size_t>(o.min_cells)) result.cells.clear();
  result.order = compare_depths(frame, cells, there, result.cells);
  return result;
}

}  // namespace kys_slam
