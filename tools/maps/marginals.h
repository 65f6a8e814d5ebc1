// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/problem.h>

#include <cstdint>
#include <vector>

#include "rig_costs.h"

namespace kys_slam {

/// What one recording says about the rig, with its poses and landmarks eliminated (marginals of the
/// normal equations; Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 6.1).
struct RigInformation {
  RigCorrection::Covariance H;  ///< information of (shape, own), without the priors
  double chi2 = 0;              ///< of the residuals, with the loss
  std::int64_t freedom = 0;     ///< residuals less unknowns
};

/// At the present place. Ceres' own covariances need a factorisation of all recordings together and
/// give up when a landmark has no depth.
RigInformation rig_information(ceres::Problem& problem,
                               const std::vector<ceres::ResidualBlockId>& residuals,
                               std::vector<Eigen::Vector3d>& landmarks,
                               std::vector<PoseBlock>& poses, double* shape, double* own);

}  // namespace kys_slam
