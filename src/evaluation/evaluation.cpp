// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/check_options.h>
#include <kys_slam/evaluation.h>

#include <utility>

namespace kys_slam {

void describe(kys::OptionList& list, EvaluationOptions& o) {
  list.add("evaluation.max_time_difference", o.max_time_difference, {0, 1e9}, "s");
  list.add("evaluation.rpe_delta", o.rpe_delta, {1, 1e9}, "frames");
}

Evaluation evaluate_pairs(TrajectoryPair pair, const EvaluationOptions& options) {
  check_options(options);
  Evaluation result;
  result.pairs = pair.size();
  result.reference_poses = pair.reference.size();
  result.estimate_poses = pair.estimate.size();
  result.alignment = align(pair, options.alignment);
  transform(pair.estimate, result.alignment);
  result.ate = statistics(absolute_errors(pair));
  const RelativeErrors relative = relative_errors(pair, options.rpe_delta, options.rpe_all_steps);
  result.rpe_translation = statistics(relative.translation);
  result.rpe_rotation = statistics(relative.rotation);
  result.kitti = kitti_errors(pair);
  result.reference_length = path_length(pair.reference);
  result.estimate_length = path_length(pair.estimate);
  return result;
}

Evaluation evaluate(std::span<const TimedPose> reference, std::span<const TimedPose> estimate,
                    const EvaluationOptions& options) {
  check_options(options);
  Evaluation result =
      evaluate_pairs(associate_by_time(reference, estimate, options.max_time_difference), options);
  result.reference_poses = reference.size();
  result.estimate_poses = estimate.size();
  return result;
}

}  // namespace kys_slam
