#pragma once

#include <vector>

#include "evaluation/association.h"

namespace kys_slam {

/// Distance of every pair of positions, m. The estimate must be aligned already.
std::vector<double> absolute_errors(const TrajectoryPair& pair);

/// Relative pose errors E_i = (Q_i^-1 Q_{i+d})^-1 (P_i^-1 P_{i+d}), Q reference, P estimate
/// (Sturm et al., IROS 2012).
struct RelativeErrors {
  std::vector<double> translation;  ///< E_t, m
  std::vector<double> rotation;     ///< E_R, degrees
};

/// \param delta      frames (associated pairs) between the two poses of a step, at least 1
/// \param all_steps  every i; else i = 0, delta, 2 delta, ... (evo's default)
RelativeErrors relative_errors(const TrajectoryPair& pair, std::size_t delta,
                               bool all_steps = false);

/// Mean errors over sub-sequences of 100, 200, .. 800 m that begin at every tenth frame, as the
/// KITTI odometry benchmark counts them. Without any such sub-sequence `segments` is 0.
struct KittiErrors {
  std::size_t segments = 0;
  double translation_percent = 0;    ///< t_rel
  double rotation_deg_per_100m = 0;  ///< r_rel
};

KittiErrors kitti_errors(const TrajectoryPair& pair);

/// Sum of the distances between successive positions, m.
double path_length(std::span<const TimedPose> poses);

}  // namespace kys_slam
