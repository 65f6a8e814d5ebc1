// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>
#include <kys_slam/rig_rows.h>

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "map_problem.h"

namespace kys_slam {

/// Parameters of the rig's correction that are estimated.
using FreeParameters = std::array<bool, RigCorrection::kSize>;
/// Names of groups of them: offset, intrinsics, baseline, rotation, distortion.
const std::vector<std::string_view>& rig_groups();
/// \throws InputError for a name that is none
FreeParameters parse_groups(const std::vector<std::string>& names);

struct RefinementOptions {
  double hold_out = 0.1;     ///< share of the observations that are not used, but predicted
  std::uint64_t seed = 1;    ///< of their choice
  FreeParameters free{};     ///< the others stay as they are in the map
  RigEstimate prior;         ///< of all parameters before anything is seen
  bool covariances = false;  ///< of keyframes
  /// With which the images were compared; nothing: that in the map. Disparities whose rows have not
  /// been measured have an error by what it does not know.
  std::optional<RigEstimate> compared_with;
  /// Adds residuals of other measurements, without loss or with one, on blocks of the map. Called
  /// whenever a problem has been built. Their deviations are taken as they are.
  std::function<void(ceres::Problem&, MapProblem&)> more;
  Watch watch;
};

struct RefinementResult {
  RigEstimate before, after;  ///< correction in the map, and refined
  /// Of observations that are used, and of those held out: in the map as it was; adjusted with its
  /// correction; adjusted with the refined one (the same without free parameters).
  struct Stage {
    Residuals used, held_out;
  };
  Stage read, adjusted, refined;
  /// Per keyframe, with `covariances`: of the increment (rad, m) exp(w) x_c + v of T_c_w, in the
  /// keyframe's own frame, relative to the keyframe of its sub-map that is held; zero for that one,
  /// and variances of 1e6 for what nothing determines.
  std::vector<Eigen::Matrix<double, 6, 6>> covariances;
  double unit = 1;  ///< standard deviation of a residual over the assumed one
  int iterations = 0;
  std::size_t observations = 0;  ///< used at the end
  bool stopped = false;
};

/// Bundle adjustment of all of a map, with some parameters of the rig free: Huber's loss, what is
/// far off left out, by SPARSE_SCHUR. Poses, landmarks and correction of the map are changed; a
/// rig without free parameters keeps its correction. Standard deviations are those of the normal
/// equations, with the noise that the residuals show. \param map the first keyframe of every
/// sub-map is held, unless its flag is cleared
RefinementResult refine(MapObservations& map, const RefinementOptions& options);

}  // namespace kys_slam
