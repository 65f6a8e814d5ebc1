#pragma once

#include <kys/option_list.h>

#include <optional>

#include "geometry/image_cells.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

struct ConsensusOptions {
  bool enabled = true;         ///< false: the matches alone decide
  int columns = kAreaColumns;  ///< cells across the image's width; cells are square
  double contested = 0.15;  ///< share of the area held by outliers from which rivals are looked for
  double clear = 3;      ///< factor on the bound of the error beyond which one is an outlier here
  double tolerance = 2;  ///< factor on the bound of the error within which area supports a pose
  double reach = 5;      ///< the same for poses that are not refined yet
  double cell_evidence = 2.5;        ///< nats, what one cell of the fixed scene says for a pose
  bool by_class = true;              ///< things that can move count as things, not by their area
  double margin = 1.02;              ///< factor by which a rival has to have more support
  double max_acceleration = 20;      ///< m/s^2, of the camera
  double doubtful_acceleration = 8;  ///< m/s^2, as no car brakes: calls for rivals
  int samples = 300;                 ///< of three matches from three cells
  std::uint64_t seed = 0;            ///< of the samples
};
/// For check_options().
void describe(kys::OptionList& list, ConsensusOptions& options);

struct ConsensusResult {
  PoseResult pose;
  bool contested = false;  ///< rivals were looked for
  bool overruled = false;  ///< the pose is not the one that most matches agree on
};

/// What an observation is on, known apart from the pose.
struct Vote {
  std::int32_t thing = -1;  ///< of those that can move; -1: of the fixed scene, or unknown
  float log_odds = 0;       ///< nats, of the thing standing still
};

/// Where a constant velocity puts the camera.
struct ExpectedPose {
  Rigid3 T_c_w;
  double reach = 0;  ///< s^2; by an acceleration this gives how far off it can be
};

/// What an initial pose is worth.
enum class Start : std::uint8_t {
  kGuess,      ///< a prediction: it may be wrong
  kConsensus,  ///< decided by image area over other matches of the frame: refined, not questioned
};

/// Pose of a frame by the image area that agrees with it, not by the number of matches.
///
/// An object that moves with the camera keeps its place in the image: nearly all its features
/// match, and its landmarks live long, while those of the scene leave their search windows. So it
/// can hold most matches and yet a small part of the image. `optimize_pose` gives the pose that
/// most matches agree on. Every occupied cell of the image has one vote, shared by its matches.
/// Where outliers hold less than the share `contested` of the area, and the camera can have come to
/// it, that pose stands as it is: a static scene is not touched. Else rivals are estimated from
/// samples of three matches from three cells that the pose does not explain (RANSAC with local
/// optimisation, Chum et al. 2003; score as MSAC, Torr and Zisserman 2000, weighted by area), and
/// from the initial pose. Support counts less the more acceleration a pose needs from what is
/// `expected`. When a rival has more support, the pose is refined over all matches that it
/// explains, each at full weight.
///
/// With `votes`, only the fixed scene counts by area. A thing that can move counts once, whatever
/// its size, by the log-odds of its standing still: a pose to which it stands still gains
/// log_odds / cell_evidence cells, or loses them. A pose is refined without the things that do not
/// stand still to it.
/// \param votes one per observation, or none
ConsensusResult estimate_pose(const StereoCamera& camera, const Rigid3& T_c_w_initial,
                              std::span<const PoseObservation> observations,
                              std::span<const Vote> votes,
                              const std::optional<ExpectedPose>& expected,
                              const ConsensusOptions& options, Start start = Start::kGuess,
                              const PoseOptions& pose = {});

}  // namespace kys_slam
