// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

namespace kys_slam {

struct SceneSupportOptions {
  int in_view = 30;      ///< stereo points with which the fixed scene is in view
  double share = 0.08;   ///< of them, inliers that support a pose
  float edge = 6;        ///< px of its octave: so near to an object's feature one may show its edge
  double longest = 0.5;  ///< s after the last support in which objects alone may hold a pose
};
/// For check_options().
void describe(kys::OptionList& list, SceneSupportOptions& options);

/// The numbers by which PoseJudge decides.
struct JudgeOptions {
  /// share of inliers below which a pose that needs an impossible acceleration is doubted; a pose
  /// found elsewhere needs it to be compared
  double min_inlier_share = 0.4;
  double inlier_drop = 0.5;      ///< of the share in the last frame; below, a pose is doubted
  double explained_share = 0.8;  ///< of inliers with which another pose replaces a doubted one
  int sample_stride = 4;         ///< every n-th landmark is searched first to test a doubt
  /// Something moves along with the camera when this share of the other matches fits a camera that
  /// has gone less than `co_moving_step` of the way.
  double co_moving_share = 0.5;
  double co_moving_step = 0.5;
  /// share of inliers with which a pose near the expected one may have few: several times the share
  /// of wrong matches that fit a pose by chance
  double expected_share = 0.15;
  SceneSupportOptions support;  ///< used when the mode has beliefs
};
/// For check_options().
void describe(kys::OptionList& list, JudgeOptions& options);

}  // namespace kys_slam
