// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/frame_source.h>

#include <cstddef>
#include <span>
#include <vector>

/// Errors of an estimated trajectory against a reference. The figures equal those of evo.
namespace kys_slam {

/// Summary of a list of errors, in their unit. The standard deviation is that of the population
/// (divided by n). The median of an even count is the mean of the two middle values. All zero for
/// no errors.
struct Statistics {
  std::size_t count = 0;
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0;
};

Statistics statistics(std::span<const double> errors);

/// Poses of a reference and of an estimate, one to one and in order of time. Both lists have the
/// same length.
struct TrajectoryPair {
  std::vector<TimedPose> reference;
  std::vector<TimedPose> estimate;

  [[nodiscard]] std::size_t size() const { return reference.size(); }
};

/// Pairs poses by time as evo does: every pose of the shorter trajectory takes the nearest one of
/// the longer when it is at most `max_difference` (s) away. Time stamps must not decrease. Repeated
/// stamps, which some published trajectories have, count as often as they occur.
TrajectoryPair associate_by_time(std::span<const TimedPose> reference,
                                 std::span<const TimedPose> estimate, double max_difference = 0.01);

enum class Alignment { kNone, kSe3, kSim3 };

/// p_reference = scale * R * p_estimate + t.
struct Similarity {
  double scale = 1;
  Rigid3 T;
  /// The positions do not determine the rotation: fewer than three, all in one place, or all on one
  /// line. The rotation is then that of the first pair of poses.
  bool degenerate = false;
};

/// Least-squares alignment of the estimate's positions to the reference's (Umeyama, PAMI 1991).
Similarity align(const TrajectoryPair& pair, Alignment alignment);

/// Applies a similarity: scales, rotates and translates positions (m), rotates orientations.
void transform(std::vector<TimedPose>& poses, const Similarity& similarity);

/// Distance of every pair of positions, m. The estimate must be aligned already.
std::vector<double> absolute_errors(const TrajectoryPair& pair);

/// Relative pose errors E_i = (Q_i^-1 Q_{i+d})^-1 (P_i^-1 P_{i+d}), Q reference, P estimate
/// (Sturm et al., IROS 2012).
struct RelativeErrors {
  std::vector<double> translation;  ///< E_t, m
  std::vector<double> rotation;     ///< E_R, degrees
};

/// \param delta      frames (associated pairs) between the two poses of a step, at least 1
/// \param all_steps  true: every i; false: i = 0, delta, 2 delta, ... (evo's default)
RelativeErrors relative_errors(const TrajectoryPair& pair, std::size_t delta,
                               bool all_steps = false);

/// Mean errors over sub-sequences of 100, 200, .. 800 m that begin at every tenth frame, as in the
/// KITTI odometry benchmark. `segments` is 0 when there is no such sub-sequence.
struct KittiErrors {
  std::size_t segments = 0;
  double translation_percent = 0;    ///< t_rel
  double rotation_deg_per_100m = 0;  ///< r_rel
};

KittiErrors kitti_errors(const TrajectoryPair& pair);

/// Sum of the distances between successive positions, m.
double path_length(std::span<const TimedPose> poses);

struct EvaluationOptions {
  Alignment alignment = Alignment::kSe3;
  double max_time_difference = 0.01;  ///< s, of associated poses
  std::size_t rpe_delta = 1;          ///< frames
  bool rpe_all_steps = false;         ///< overlapping steps when rpe_delta > 1
};
/// For check_options().
void describe(kys::OptionList& list, EvaluationOptions& options);

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

/// Associates, aligns, measures. Both trajectories must be poses of the same frame (left camera).
/// With fewer than two associated poses (`pairs`) all figures are zero.
Evaluation evaluate(std::span<const TimedPose> reference, std::span<const TimedPose> estimate,
                    const EvaluationOptions& options = {});

/// The same for poses that are associated already, index by index.
Evaluation evaluate_pairs(TrajectoryPair pair, const EvaluationOptions& options = {});

}  // namespace kys_slam
