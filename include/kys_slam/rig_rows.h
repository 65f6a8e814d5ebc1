// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>

#include <span>

namespace kys_slam {

/// What calibrations are worth before anything is seen: covariance of the parameters of a rig.
RigCorrection::Covariance rig_prior();

/// L with L L^T = covariance; a parameter of variance zero, which stays, has a row of zeros.
RigCorrection::Covariance root_of(const RigCorrection::Covariance& covariance);

/// A stereo match with its row in the right image.
struct RowObservation {
  RigCorrection::Measured measured;
  float scale = 1;  ///< px of level 0 per px of its octave: standard deviations grow with it
};

/// What the rows of stereo matches show about a rig.
struct RowFit {
  RigEstimate rig;
  std::size_t observations = 0;
  double sigma_before = 0;  ///< px, robust standard deviation of row differences, as given
  double sigma_after = 0;   ///< px, the same with the correction
  double field = 0;         ///< px, root mean square of what the correction changes in rows
};

/// Fits the correction to rows alone: robust least squares with the prior. Directions that rows do
/// not show stay at `start`, which is the mean of the prior.
/// \param start mean and covariance of the prior; parameters that do not change have
/// variance zero
RowFit fit_rows(const StereoCamera& given, std::span<const RowObservation> observations,
                const RigEstimate& start);

}  // namespace kys_slam
