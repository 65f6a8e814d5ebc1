// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>
#include <kys_slam/rigid3.h>

#include <atomic>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// Poses, points and the correction of the rig, with what was measured in the images.
struct RigProblem {
  struct Observation {
    RigCorrection::Measured measured;  ///< without a column: left image alone
    std::uint32_t pose = 0;
    float scale = 1;      ///< px of level 0 per px of the octave
    float inv_sigma = 1;  ///< 1/px, of u
    bool row = false;     ///< the row in the right image is measured, not expected
  };
  StereoCamera camera;
  /// Mean and covariance of the parameters. One without variance stays: one has some, or all have.
  RigEstimate prior;
  RigCorrection rig;                      ///< changed in place
  double information_v = 1;               ///< of v over that of u
  double information_disparity = 1;       ///< of the disparity over that of u
  std::vector<Rigid3> T_c_w;              ///< changed in place
  std::vector<std::uint8_t> pose_fixed;   ///< per pose, at least one not zero
  std::vector<Eigen::Vector3d> points;    ///< p_w, m; changed in place
  std::vector<Observation> observations;  ///< by point
  std::vector<std::int32_t> first{0};     ///< per point its first observation; then their number
};

struct RigSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  int observations = 0;  ///< used in the last round
  bool stopped = false;
  /// Of the parameters, from the normal equations at the end; the noise is what the residuals say.
  RigCorrection::Covariance covariance = RigCorrection::Covariance::Zero();
  double unit = 1;  ///< standard deviation of a residual over the assumed one
};

/// Minimises reprojection errors in the perfect pair, and row differences where they were measured,
/// over poses, points and the correction of the rig (bundle adjustment with self-calibration;
/// Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 2.3 and 6.1): Huber's loss,
/// observations far off left out. Points are eliminated; the rest is dense, so that problems have
/// at most some hundred poses. One thread; the same bytes every time.
RigSummary adjust_rig(RigProblem& problem, const std::atomic<bool>* stop = nullptr);

}  // namespace kys_slam
