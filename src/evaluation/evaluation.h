#pragma once

#include "evaluation/alignment.h"
#include "evaluation/association.h"
#include "evaluation/errors.h"
#include "evaluation/statistics.h"

namespace kys_slam {

struct EvaluationOptions {
  Alignment alignment = Alignment::kSe3;
  double max_time_difference = 0.01;  ///< s, of associated poses
  std::size_t rpe_delta = 1;          ///< frames
  bool rpe_all_steps = false;         ///< overlapping steps when rpe_delta > 1
};

/// Figures of an estimate against a reference.
struct Evaluation {
  std::size_t reference_poses = 0;  ///< as given
  std::size_t estimate_poses = 0;   ///< as given
  std::size_t pairs = 0;            ///< associated; all figures are over these
  Similarity alignment;
  Statistics ate;              ///< m
  Statistics rpe_translation;  ///< m per delta
  Statistics rpe_rotation;     ///< degrees per delta
  KittiErrors kitti;
  double reference_length = 0;  ///< m, over the pairs
  double estimate_length = 0;   ///< m, over the pairs, after alignment
};

/// Associates, aligns, measures. Both trajectories must be of the same frame (left camera).
/// With fewer than two associated poses, the figures are zero and `pairs` tells.
Evaluation evaluate(std::span<const TimedPose> reference, std::span<const TimedPose> estimate,
                    const EvaluationOptions& options = {});

/// The same for poses that belong together already, index by index.
Evaluation evaluate_pairs(TrajectoryPair pair, const EvaluationOptions& options = {});

}  // namespace kys_slam
