#include "mapping/rig_calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
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

constexpr std::array kLooks = {1, 2, 8};  // times `keyframes`, in the map at an estimate
constexpr double kMore = 1.25;  // keyframes at the end of a run over those at the estimate before
// Least share of `keyframes` in the map at an estimate, for its systematic error: that of 80
// keyframes is no smaller where all of them look along one street.
constexpr double kLeastShare = 0.5;
// What the last estimate must differ by from an offset that is there: standard deviations from
// noise, since the systematic error is in both.
constexpr double kRefinement = 2;
constexpr int kIterations = 10;  // of both rounds, after the disparities have changed
constexpr std::size_t kMostKeyframes = 80;
constexpr std::size_t kMostObservations = 30000;
constexpr int kLeastObservations = 300;
constexpr double kOffsetPrior = 1;  // px, standard deviation, of the offset alone

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
void adjust_whole(Map& map, const std::atomic<bool>* stop) {
  Whole whole = whole_map(map);
  const double before = camera_path_length(whole.problem.T_c_w);
  BundleOptions options;
  options.iterations = options.refine_iterations = kIterations;
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

}  // namespace

std::optional<RigEstimate> estimate_rig(const Map& map, const RigCalibrationOptions& options,
                                        const RigEstimate& prior, const std::atomic<bool>* stop) {
  RigProblem problem = rig_problem(map, newest_keyframes(map, kMostKeyframes),
                                   options.min_observers, kMostObservations);
  if (map.rig().bends()) {
    problem.prior = prior;
  } else {
    problem.prior.covariance(kAtOffset, kAtOffset) = kOffsetPrior * kOffsetPrior;
  }
  const RigSummary summary = adjust_rig(problem, stop);
  if (getenv("RIGDBG")) {
    fprintf(stderr, "LOOK kf %zu obs %zu/%d cost %.1f -> %.1f unit %.3f it %d\n",
            problem.T_c_w.size(), problem.observations.size(), summary.observations,
            summary.initial_cost, summary.final_cost, summary.unit, summary.iterations);
    for (int k = 0; k < RigCorrection::kSize; ++k)
      fprintf(stderr, " %s %.5f+-%.5f", rig_parameter_names()[k].name.data(),
              problem.rig.parameters()[k], std::sqrt(summary.covariance(k, k)));
    fprintf(stderr, "\n");
  }
  if (summary.stopped || summary.observations < kLeastObservations) return {};
  if (!problem.rig.parameters().allFinite() || !summary.covariance.allFinite()) return {};
  return RigEstimate{problem.rig, summary.covariance};
}

bool RigCalibration::update(Map& map, const std::atomic<bool>* stop) {
  if (!options_.enabled || looks_ >= kLooks.size()) return false;
  const auto unit = static_cast<std::size_t>(options_.keyframes);
  if (map.keyframes().size() < unit * kLooks[looks_]) return false;
  ++looks_;
  return look(map, looks_ == kLooks.size(), stop);
}

bool RigCalibration::finish(Map& map, const std::atomic<bool>* stop) {
  if (looks_ == 0 || looks_ >= kLooks.size()) return false;
  const auto keyframes = static_cast<double>(map.keyframes().size());
  if (keyframes < kMore * static_cast<double>(seen_)) return false;
  looks_ = kLooks.size();
  return look(map, false, stop);
}

/// Whether an estimate of the offset alone is to be applied. Decided anew every time, with all
/// there is to see by then: an offset that was put in on thin evidence goes again.
bool RigCalibration::is_worth(const Map& map, RigEstimate& found, bool last) const {
  const double total = found.correction.offset();
  const double noise = std::sqrt(found.covariance(kAtOffset, kAtOffset));
  const double share = static_cast<double>(options_.keyframes) / static_cast<double>(seen_);
  const double systematic = options_.systematic * std::sqrt(std::clamp(share, kLeastShare, 1.0));
  const double sigma = std::hypot(noise, systematic);
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

bool RigCalibration::look(Map& map, bool last, const std::atomic<bool>* stop) {
  seen_ = map.keyframes().size();
  std::optional<RigEstimate> found = estimate_rig(map, options_, prior_, stop);
  if (!found) return false;
  if (!map.rig().bends() && !is_worth(map, *found, last)) return false;
  map.set_rig(*found);
  adjust_whole(map, stop);
  return true;
}

}  // namespace kys_slam
