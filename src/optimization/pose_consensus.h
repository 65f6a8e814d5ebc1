// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <optional>

#include "geometry/image_cells.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

struct ConsensusOptions {
  bool enabled = true;         ///< false: the pose with most inlier matches is used
  int columns = kAreaColumns;  ///< cells across the image's width; cells are square
  /// share of the area with outliers above which competing poses are searched
  double contested = 0.15;
  double clear = 3;      ///< factor on the error bound beyond which a match is an outlier here
  double tolerance = 2;  ///< factor on the error bound within which area supports a pose
  double reach = 5;      ///< the same for poses before refinement
  double cell_evidence = 2.5;    ///< nats, evidence of one cell of the static scene for a pose
  bool by_class = true;          ///< an instance that can move counts once, not by its area
  double margin = 1.02;          ///< factor on the support that a competing pose must exceed
  double max_acceleration = 20;  ///< m/s^2, of the camera
  /// m/s^2, more than a car brakes: competing poses are searched
  double doubtful_acceleration = 8;
  int samples = 300;       ///< of three matches from three cells
  std::uint64_t seed = 0;  ///< of the samples
};
/// For check_options().
void describe(kys::OptionList& list, ConsensusOptions& options);

struct ConsensusResult {
  PoseResult pose;
  bool contested = false;  ///< competing poses were searched
  bool overruled = false;  ///< the pose is not the one with most inlier matches
};

/// Prior of an observation, independent of the pose.
struct Vote {
  std::int32_t instance = -1;  ///< instance that can move; -1: static scene, or not known
  float log_odds = 0;          ///< nats, of the instance being static
};

/// Pose predicted by constant velocity.
struct ExpectedPose {
  Rigid3 T_c_w;
  double reach = 0;  ///< s^2; times an acceleration (m/s^2) it gives the possible error, m
};

/// Reliability of an initial pose.
enum class Start : std::uint8_t {
  kGuess,      ///< a prediction, which may be wrong
  kConsensus,  ///< decided by image area over other matches of the frame: refined, no competing
               ///< poses
};

/// Pose of a frame by the image area that agrees with it, not by the number of matches.
///
/// An object that moves with the camera stays at its position in the image: nearly all its features
/// match and its landmarks survive, while those of the scene leave their search windows. So it can
/// have most matches on a small part of the image. `optimize_pose` gives the pose with most inlier
/// matches. Every occupied cell of the image has one vote, shared by its matches. When outliers
/// have less than the share `contested` of the area, and the acceleration to the pose is possible,
/// that pose is returned unchanged: a static scene is not affected. Otherwise competing poses are
/// estimated from the initial pose, with `votes` from the fixed scene alone, and from samples of
/// three matches in three cells that are outliers of the pose (RANSAC with local optimisation, Chum
/// et al. 2003; score as MSAC, Torr and Zisserman 2000, weighted by area). Support decreases with
/// the acceleration that a pose needs relative to `expected`. When a competing pose has more
/// support, it is refined over all its inliers, each at full weight.
///
/// With `votes`, only the static scene counts by area. An instance that can move counts once, for
/// any size, by the log-odds of being static: a pose for which it is static gains (or loses)
/// log_odds / cell_evidence cells. A pose is refined without the instances that are not static for
/// it.
/// \param votes one per observation, or none
ConsensusResult estimate_pose(const StereoCamera& camera, const Rigid3& T_c_w_initial,
                              std::span<const PoseObservation> observations,
                              std::span<const Vote> votes,
                              const std::optional<ExpectedPose>& expected,
                              const ConsensusOptions& options, Start start = Start::kGuess,
                              const PoseOptions& pose = {});

}  // namespace kys_slam
