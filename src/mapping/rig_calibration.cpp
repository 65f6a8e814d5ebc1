// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/rig_calibration.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

#include "geometry/camera_path.h"
#include "mapping/local_bundle.h"
#include "mapping/rig_view.h"
#include "optimization/rig_bundle.h"

namespace kys_slam {

void describe(kys::OptionList& list, RigCalibrationOptions& o) {
  list.add("calibration.enabled", o.enabled,
           "correct the calibration by what the images show: rows and disparities");
  list.add(
      "calibration.keyframes", o.keyframes, {2, 1e9}, "",
      "keyframes in the map at the first estimate; others at 2 and 8 times that, or at the end");
  list.add("calibration.significance", o.significance, {0, 1e6}, "standard deviations",
           "by which the offset of disparities must differ from zero to be applied alone");
  list.add("calibration.systematic", o.systematic, {0, 100}, "px",
           "standard deviation of its error in addition to that from noise, in a map of "
           "calibration.keyframes; with more it falls to 0.7 times");
  list.add("calibration.max_correction", o.max_correction, {0, 100}, "px",
           "a larger offset is not applied");
  const kys::OptionList::Fixed fixed(list);
  list.add("calibration.min_observers", o.min_observers, {1, 1000});
}

namespace {

// Keyframes in the map at the estimates, over `keyframes`. Of an offset alone: as many as make it
// certain. A miscalibrated rig changes disparities by half a pixel and more, and what a map keeps
// is what agrees with them, so that a late estimate finds a part of the error only: the first comes
// early. On rendered blocks the rest was 0.06-0.12 px with a first one at 20, 0.02-0.04 px at 8.
constexpr std::array kOffsetEstimates = {1.0, 2.0, 8.0};
constexpr std::array kRigEstimates = {0.25, 0.5, 1.0, 2.0, 4.0, 8.0};

std::span<const double> schedule_of(const Map& map) {
  if (map.rig().bends()) return kRigEstimates;
  return kOffsetEstimates;
}

constexpr double kMore = 1.25;  // keyframes at the end of a run over those at the estimate before
// Least share of `keyframes` in the map at an estimate, for its systematic error: that of 80
// keyframes is no smaller where all of them look along one street.
constexpr double kLeastShare = 0.5;
// What the last estimate must differ by from an offset that is there: standard deviations from
// noise, since the systematic error is in both.
constexpr double kRefinement = 2;
constexpr int kIterations = 10;    // of both rounds, after the disparities have changed
constexpr int kFewIterations = 4;  // the same, from the poses of the estimate
constexpr std::size_t kMostKeyframes = 80;
constexpr std::size_t kMostObservations = 20000;
constexpr int kLeastObservations = 300;
// Standard deviations of the prior that a parameter may be from its mean: beyond, the estimate is a
// failure, or no calibration error.
constexpr double kMostFromPrior = 6;
constexpr double kOffsetPrior = 1;  // px, standard deviation, of the offset alone

/// Of all keyframes, m.
double path_length(const Map& map) {
  std::vector<Rigid3> poses;
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) { poses.push_back(k.T_c_w); });
  return camera_path_length(poses);
}

struct Whole {
  std::vector<KeyFrameId> poses;
  std::vector<LandmarkId> landmarks;
  BundleProblem problem;
};

Whole whole_map(const Map& map) {
  Whole whole;
  whole.problem.camera = map.camera();
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    whole.poses.push_back(id);
    whole.problem.T_c_w.push_back(keyframe.T_c_w);
    whole.problem.pose_fixed.push_back(keyframe.parent.valid() ? 0 : 1);
  });
  // All landmarks, those with one stereo view as well: what stayed behind would mislead the
  // tracker.
  whole.landmarks = map.landmarks().ids();
  add_landmarks(map, whole.poses, whole.landmarks, whole.problem);
  return whole;
}

/// Adjusts the whole map after the disparities have changed.
/// \param before length of the camera's path until then, m
void adjust_whole(Map& map, double before, int iterations, const std::atomic<bool>* stop) {
  Whole whole = whole_map(map);
  BundleOptions options;
  options.iterations = options.refine_iterations = iterations;
  options.stop = stop;
  adjust_bundle(whole.problem, options);
  if (before > 0) map.note_rescaling(camera_path_length(whole.problem.T_c_w) / before);
  for (std::size_t k = 0; k < whole.poses.size(); ++k) {
    if (whole.problem.pose_fixed[k] == 0) map.set_pose(whole.poses[k], whole.problem.T_c_w[k]);
  }
  for (std::size_t k = 0; k < whole.landmarks.size(); ++k) {
    map.set_position(whole.landmarks[k], whole.problem.points[k]);
  }
  map.refresh_geometry(map.landmarks().ids());
}

constexpr int kAtOffset = static_cast<int>(RigParameter::kOffset);

RigView view_of(const Map& map, const RigCalibrationOptions& options) {
  return rig_view(map, newest_keyframes(map, kMostKeyframes), options.min_observers,
                  kMostObservations);
}

bool is_plausible(const RigCorrection& found, const RigEstimate& prior) {
  const RigCorrection::Parameters off = found.parameters() - prior.correction.parameters();
  const RigCorrection::Parameters most = kMostFromPrior * prior.covariance.diagonal().cwiseSqrt();
  return (off.array().abs() <= most.array()).all();  // false for NaN
}

/// Solves the problem of a view. \return nothing without enough to see, or when stopped
std::optional<RigEstimate> solve(RigView& view, const RigEstimate& prior,
                                 const std::atomic<bool>* stop) {
  RigProblem& problem = view.problem;
  if (problem.rig.bends()) {
    problem.prior = prior;
  } else {
    problem.prior.covariance(kAtOffset, kAtOffset) = kOffsetPrior * kOffsetPrior;
  }
  const RigSummary summary = adjust_rig(problem, stop);
  if (summary.stopped || summary.observations < kLeastObservations) return {};
  if (!is_plausible(problem.rig, problem.prior) || !summary.covariance.allFinite()) return {};
  return RigEstimate{problem.rig, summary.covariance};
}

}  // namespace

std::optional<RigEstimate> estimate_rig(const Map& map, const RigCalibrationOptions& options,
                                        const RigEstimate& prior, const std::atomic<bool>* stop) {
  RigView view = view_of(map, options);
  return solve(view, prior, stop);
}

bool RigCalibration::update(Map& map, std::size_t seen, const std::atomic<bool>* stop) {
  const std::span<const double> schedule = schedule_of(map);
  if (!options_.enabled || estimates_made_ >= schedule.size()) return false;
  const auto keyframes = static_cast<double>(seen);
  if (keyframes < static_cast<double>(options_.keyframes) * schedule[estimates_made_]) return false;
  ++estimates_made_;
  return estimate(map, seen, estimates_made_ == schedule.size(), stop);
}

bool RigCalibration::finish(Map& map, std::size_t seen, const std::atomic<bool>* stop) {
  const std::size_t all = schedule_of(map).size();
  if (estimates_made_ == 0 || estimates_made_ >= all) return false;
  const auto keyframes = static_cast<double>(seen);
  if (keyframes < kMore * static_cast<double>(seen_)) return false;
  estimates_made_ = all;
  return estimate(map, seen, false, stop);
}

/// Whether an estimate of the offset alone is to be applied. Decided anew every time, with all
/// there is to see by then: an offset that was put in on thin evidence goes again.
bool RigCalibration::is_worth(const Map& map, RigEstimate& found, bool last) {
  const double total = found.correction.offset();
  const double noise = std::sqrt(found.covariance(kAtOffset, kAtOffset));
  const double share = static_cast<double>(options_.keyframes) / static_cast<double>(seen_);
  const double systematic = options_.systematic * std::sqrt(std::clamp(share, kLeastShare, 1.0));
  const double sigma = kys::portable::hypot(noise, systematic);
  offset_ = OffsetEstimate{total, sigma, total == map.rig().offset()};
  if (noise <= 0 || std::abs(total) > options_.max_correction) return false;
  found.covariance(kAtOffset, kAtOffset) = sigma * sigma;
  const double present = map.rig().offset();
  if (std::abs(total) <= options_.significance * sigma) {
    found.correction = {};
    return present != 0;
  }
  // One that is there already is not moved by less than the estimate is sure of.
  const double least = last ? kRefinement * noise : sigma;
  return present == 0 || std::abs(total - present) >= least;
}

bool RigCalibration::estimate(Map& map, std::size_t keyframes, bool last,
                              const std::atomic<bool>* stop) {
  seen_ = keyframes;
  RigView view = view_of(map, options_);
  std::optional<RigEstimate> found = solve(view, prior_, stop);
  if (!found) return false;
  if (!map.rig().bends() && !is_worth(map, *found, last)) return false;
  map.set_rig(*found);
  if (offset_) offset_->applied = map.rig().offset() == offset_->value;
  const double before = path_length(map);
  // The poses of the estimate are those of its correction, which an offset may have lost.
  const bool begun = map.keyframes().size() <= kMostKeyframes && map.rig() == view.problem.rig;
  if (begun) view.write_to(map);
  adjust_whole(map, before, begun ? kFewIterations : kIterations, stop);
  return true;
}

}  // namespace kys_slam
