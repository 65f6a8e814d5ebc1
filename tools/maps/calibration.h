// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include <cstdint>
#include <string>
#include <vector>

#include "map_problem.h"

namespace kys_slam {

/// A recording of the rig, as its map shows it.
struct Recording {
  std::string name;
  MapObservations map;
};

struct CalibrationOptions {
  double hold_out = 0.1;    ///< share of the observations that are not used, but predicted
  std::uint64_t seed = 1;   ///< of their choice
  bool keep_shape = false;  ///< the shape stays as in `start`
  /// Mean and covariance of the parameters before anything is seen.
  RigCorrection::Parameters start = RigCorrection::Parameters::Zero();
  RigCorrection::Covariance prior;
  Watch watch;
};

struct RecordingResult {
  RigEstimate rig;   ///< the shape, and what this recording has of its own
  Residuals before;  ///< with the given calibration, poses and points fitted to it
  Residuals after;   ///< of observations that were not used, as before
  std::size_t keyframes = 0, landmarks = 0, observations = 0;
};

struct CalibrationResult {
  std::vector<RecordingResult> recordings;
  double unit = 1;  ///< standard deviation of a residual over the assumed one
  int iterations = 0;
  bool stopped = false;

  /// For a recording to come: the shape as found; the mean of what the recordings have of their
  /// own, with the prior's covariance.
  [[nodiscard]] RigEstimate estimate(const StereoCamera& given,
                                     const RigCorrection::Covariance& prior) const;
};

/// Estimates the correction of a rig from several recordings: bundle adjustment of all of them with
/// one shape of the rig, and what changes between recordings free in each. Huber's loss; what is
/// far off is left out. One thread: the same input gives the same bytes. \param recordings of one
/// camera; their poses and landmarks are moved
CalibrationResult calibrate(std::vector<Recording>& recordings, const CalibrationOptions& options);

}  // namespace kys_slam
