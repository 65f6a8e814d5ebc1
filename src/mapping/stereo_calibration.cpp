// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/stereo_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "geometry/camera_path.h"
#include "mapping/local_bundle.h"

namespace kys_slam {

void describe(kys::OptionList& list, StereoCalibrationOptions& o) {
  list.add("calibration.enabled", o.enabled,
           "estimate a constant offset of all disparities from the map");
  list.add(
      "calibration.keyframes", o.keyframes, {2, 1e9}, "",
      "keyframes in the map at the first estimate; others at 2 and 8 times that, or at the end");
  list.add("calibration.significance", o.significance, {0, 1e6}, "standard deviations",
           "by which it must differ from zero to be applied");
  list.add("calibration.systematic", o.systematic, {0, 100}, "px",
           "standard deviation of its error in addition to that from noise, in a map of "
           "calibration.keyframes; with more it falls to 0.7 times");
  list.add("calibration.max_correction", o.max_correction, {0, 100}, "px",
           "a larger estimate is not applied");
  const kys::OptionList::Fixed fixed(list);
  list.add("calibration.min_observers", o.min_observers, {1, 1000});
}

namespace {

constexpr double kStep = 0.2;             // px between the offsets that are tried
constexpr std::array kLooks = {1, 2, 8};  // times `keyframes`, in the map at an estimate
constexpr double kMore = 1.25;  // keyframes at the end of a run over those at the estimate before
// Least share of `keyframes` in the map at an estimate, for its systematic error: that of 80
// keyframes is no smaller where all of them look along one street.
constexpr double kLeastShare = 0.5;
// What the last estimate must differ by from an offset that is there: standard deviations from
// noise, since the systematic error is in both.
constexpr double kRefinement = 2;
// The second looks around, and sets outliers aside at, the first's vertex, where that is off zero.
constexpr int kRounds = 2;
// Square of Huber's delta. Without images errors are about half of what kPixelSigma allows, and
// this bends for the few per cent at depth edges, whose disparities lean towards the nearer
// surface. With the weights of features in images it bends for most: the cost grows nearly as the
// errors.
constexpr double kHuber = 0.5;
// Factor on the information of disparities. That of aligned keypoints is as measured
// (kImageInformation). Corners as they are found repeat to about 0.26 px, disparities to 0.09 px of
// the octave. It matters here: the inverse distances that several views give are as uncertain as
// the corners, and taken for more accurate than they are they flatten the line through (inverse
// distance, disparity) and raise its intercept, which is the offset.
constexpr double kWeightAligned = 1;
constexpr double kWeightFound = 8;
// Of each of two rounds: before an estimate, where local bundle adjustment has left the map near
// its minimum, and after the disparities have changed.
constexpr int kFewIterations = 3;
constexpr int kManyIterations = 10;
constexpr float kLargestScale = 1.5f;  // px per px of the octave, of disparities to be used

struct Whole {
  std::vector<KeyFrameId> poses;
  std::vector<LandmarkId> landmarks;
  std::vector<ObservationRef> seen;  // one per observation of the problem
  BundleProblem problem;
};

Whole whole_map(const Map& map, int min_observers) {
  Whole whole;
  whole.problem.camera = map.camera();
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    whole.poses.push_back(id);
    whole.problem.T_c_w.push_back(keyframe.T_c_w);
    whole.problem.pose_fixed.push_back(keyframe.parent.valid() ? 0 : 1);
  });
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    if (static_cast<int>(landmark.observations.size()) >= min_observers) {
      whole.landmarks.push_back(id);
    }
  });
  whole.seen = add_landmarks(map, whole.poses, whole.landmarks, whole.problem);
  return whole;
}

/// Coarse octaves mix more surfaces in a patch: their error grows with their scale and is no
/// constant. There only the left pixel counts.
void drop_coarse_disparities(const Map& map, Whole& whole) {
  for (std::size_t k = 0; k < whole.seen.size(); ++k) {
    const ObservationRef& o = whole.seen[k];
    const std::size_t octave = map.keyframe(o.keyframe).features->keypoint(o.feature).octave;
    if (map.scales().scale[octave] > kLargestScale) {
      whole.problem.observations[k].u_right = std::numeric_limits<float>::quiet_NaN();
    }
  }
}

/// Information of disparities over that of corners in a problem.
double disparity_weight(const Map& map, const Whole& whole) {
  const auto aligned = std::count_if(whole.seen.begin(), whole.seen.end(), [&](const auto& o) {
    return map.keyframe(o.keyframe).features->is_aligned(o.feature);
  });
  return 2 * static_cast<std::size_t>(aligned) >= whole.seen.size() ? kWeightAligned : kWeightFound;
}

void shift_disparities(BundleProblem& problem, double offset) {
  for (auto& o : problem.observations) o.u_right -= static_cast<float>(offset);
}

/// Adjusts poses and points with the weights of the map. \param iterations of each of two rounds
BundleSummary adjust_as_in_map(BundleProblem& problem, int iterations,
                               const std::atomic<bool>* stop) {
  BundleOptions refine;
  refine.iterations = iterations;
  refine.refine_iterations = iterations;
  refine.stop = stop;
  return adjust_bundle(problem, refine);
}

/// Adjusts poses and points and takes out what does not fit: the same observations have to serve at
/// every offset, or the costs could not be compared. Disparities do not count more here than in the
/// map: a narrow bound around the present offset would keep what agrees with it, and the estimate
/// would move by half of the offset or less. Returns false when it was stopped.
bool keep_inliers(BundleProblem& problem, const std::atomic<bool>* stop) {
  const BundleSummary refined = adjust_as_in_map(problem, kFewIterations, stop);
  std::size_t kept = 0;
  std::size_t from = 0;
  for (std::size_t point = 1; point < problem.first.size(); ++point) {
    for (; from < static_cast<std::size_t>(problem.first[point]); ++from) {
      if (refined.outlier[from] == 0) problem.observations[kept++] = problem.observations[from];
    }
    problem.first[point] = static_cast<std::int32_t>(kept);
  }
  problem.observations.resize(kept);
  return !refined.stopped;
}

/// Number of residuals beyond that of the unknowns; points without observations are none.
int redundancy_of(const BundleProblem& problem) {
  int residuals = 0;
  for (const auto& o : problem.observations) residuals += std::isnan(o.u_right) ? 2 : 3;
  int points = 0;
  for (std::size_t k = 0; k < problem.points.size(); ++k) {
    points += problem.first[k + 1] > problem.first[k] ? 1 : 0;
  }
  return residuals - 6 * static_cast<int>(problem.T_c_w.size()) - 3 * points;
}

/// Through the costs of the whole map at three offsets.
struct Parabola {
  double vertex;     // px, from the middle one
  double curvature;  // 1/px^2
  double cost;       // at the middle one
};

/// Cost at its minimum with disparities shifted; the problem's poses and points are moved there.
std::optional<double> least_cost(BundleProblem& problem, double offset, double disparity_weight,
                                 int iterations, const std::atomic<bool>* stop) {
  BundleOptions exact;
  // A cost that is not near its minimum moves the vertex. Landmarks of little parallax are slow,
  // but not when each goes to its own best place after every step. A tolerance of 1e-4 moves it by
  // up to 0.001 px.
  exact.iterate_points = true;
  exact.iterations = iterations;
  exact.refine_iterations = 0;
  exact.disparity_weight = disparity_weight;
  exact.chi2_mono = exact.chi2_stereo = kHuber;
  exact.function_tolerance = 1e-5;
  exact.stop = stop;
  const std::vector<BundleProblem::Observation> unshifted = problem.observations;
  shift_disparities(problem, offset);
  const BundleSummary summary = adjust_bundle(problem, exact);
  problem.observations = unshifted;
  if (summary.stopped) return {};
  return summary.final_cost;
}

/// As far beyond `centre` as `other` is before it.
BundleProblem mirrored(const BundleProblem& other, const BundleProblem& centre) {
  BundleProblem result = centre;
  for (std::size_t k = 0; k < result.points.size(); ++k) {
    result.points[k] += centre.points[k] - other.points[k];
  }
  for (std::size_t k = 0; k < result.T_c_w.size(); ++k) {
    result.T_c_w[k] = centre.T_c_w[k] * other.T_c_w[k].inverse() * centre.T_c_w[k];
  }
  return result;
}

/// Every minimum begins where the ones before say it will be: the vertex is then within 0.0005 px
/// of where 100 iterations each take it.
std::optional<Parabola> profile(BundleProblem problem, double disparity_weight,
                                const std::atomic<bool>* stop) {
  const auto middle = least_cost(problem, 0, disparity_weight, 8, stop);
  if (!middle) return {};
  BundleProblem shifted = problem;
  const auto above = least_cost(shifted, kStep, disparity_weight, 5, stop);
  if (!above) return {};
  shifted = mirrored(shifted, problem);
  const auto below = least_cost(shifted, -kStep, disparity_weight, 3, stop);
  if (!below) return {};
  const double curvature = (*below - 2 * *middle + *above) / (kStep * kStep);
  if (!(curvature > 0)) return {};
  return Parabola{(*below - *above) / (2 * kStep) / curvature, curvature, *middle};
}

}  // namespace

DisparityOffset estimate_disparity_offset(const Map& map, const StereoCalibrationOptions& options,
                                          const std::atomic<bool>* stop) {
  Whole whole = whole_map(map, options.min_observers);
  drop_coarse_disparities(map, whole);
  const double weight = disparity_weight(map, whole);
  DisparityOffset result;
  for (int round = 0; round < kRounds; ++round) {
    BundleProblem problem = whole.problem;
    shift_disparities(problem, result.offset);
    if (!keep_inliers(problem, stop)) return {};
    const int redundancy = redundancy_of(problem);
    const std::optional<Parabola> parabola = profile(std::move(problem), weight, stop);
    if (!parabola || redundancy < 100) return {};
    result.offset += parabola->vertex;
    const double variance = 2 * parabola->cost / redundancy;  // of a unit residual
    result.sigma = std::sqrt(variance / parabola->curvature);
    if (std::abs(parabola->vertex) < options.systematic) break;
  }
  return result;
}

bool StereoCalibration::update(Map& map, const std::atomic<bool>* stop) {
  if (!options_.enabled || looks_ >= kLooks.size()) return false;
  const auto unit = static_cast<std::size_t>(options_.keyframes);
  if (map.keyframes().size() < unit * kLooks[looks_]) return false;
  ++looks_;
  return look(map, looks_ == kLooks.size(), stop);
}

bool StereoCalibration::finish(Map& map, const std::atomic<bool>* stop) {
  if (looks_ == 0 || looks_ >= kLooks.size()) return false;
  const auto keyframes = static_cast<double>(map.keyframes().size());
  if (keyframes < kMore * static_cast<double>(seen_)) return false;
  looks_ = kLooks.size();
  return look(map, false, stop);
}

bool StereoCalibration::look(Map& map, bool last, const std::atomic<bool>* stop) {
  seen_ = map.keyframes().size();
  const DisparityOffset found = estimate_disparity_offset(map, options_, stop);
  const double total = map.disparity_offset() + found.offset;
  const double share = static_cast<double>(options_.keyframes) / static_cast<double>(seen_);
  const double systematic = options_.systematic * std::sqrt(std::clamp(share, kLeastShare, 1.0));
  const double sigma = std::hypot(found.sigma, systematic);
  if (found.sigma <= 0 || std::abs(total) > options_.max_correction) return false;
  // Decided anew at every look, with all there is to see by then: an offset that was put in on
  // thin evidence goes again.
  const bool significant = std::abs(total) > options_.significance * sigma;
  const auto offset = static_cast<float>(significant ? total : 0);
  if (!significant && map.disparity_offset() == 0) return false;
  // One that is there already is not moved by less than the estimate is sure of.
  const double least = last ? kRefinement * found.sigma : sigma;
  if (significant && map.disparity_offset() != 0 && std::abs(found.offset) < least) return false;

  map.set_disparity_offset(offset);
  // All landmarks, those with one stereo view as well: what stayed behind would mislead the
  // tracker.
  Whole whole = whole_map(map, 1);
  const double before = camera_path_length(whole.problem.T_c_w);
  adjust_as_in_map(whole.problem, kManyIterations, stop);
  if (before > 0) map.note_rescaling(camera_path_length(whole.problem.T_c_w) / before);
  for (std::size_t k = 0; k < whole.poses.size(); ++k) {
    if (whole.problem.pose_fixed[k] == 0) map.set_pose(whole.poses[k], whole.problem.T_c_w[k]);
  }
  for (std::size_t k = 0; k < whole.landmarks.size(); ++k) {
    map.set_position(whole.landmarks[k], whole.problem.points[k]);
  }
  map.refresh_geometry(map.landmarks().ids());
  return true;
}

}  // namespace kys_slam
