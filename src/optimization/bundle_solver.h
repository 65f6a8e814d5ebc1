// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "optimization/bundle_adjustment.h"

namespace kys_slam {

/// One minimisation over a fixed set of observations: input from adjust_bundle to its solver.
struct BundleRound {
  std::span<const std::uint8_t> active;      ///< per observation: used
  std::span<const std::uint8_t> pose_fixed;  ///< per pose, at least one for the gauge
  bool robust = true;
  int iterations = 10;
  bool sparse = false;  ///< reduced system of solve_bundle_schur
};

struct BundleRoundSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  bool stopped = false;
};

/// Changes T_c_w and points of the problem in place, and leaves them valid when stopped.
BundleRoundSummary solve_bundle_schur(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round);

}  // namespace kys_slam
