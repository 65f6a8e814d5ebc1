// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <cstdint>

namespace kys_slam {

/// When a pose is reported as degraded or contradicted.
struct IntegrityOptions {
  bool enabled = true;
  double max_sigma = 0.1;    ///< m, of the position against the map in its least certain direction
  int min_inliers = 30;      ///< landmarks
  double min_share = 0.25;   ///< of inliers in the matches
  double unexplained = 0.1;  ///< share of the area without inliers from which motions are compared
  /// Area of another motion, as a part of that of the pose, that contradicts the pose; the same
  /// when it is of what lies behind.
  double other_area = 0.8;
  double other_area_behind = 0.15;
  int points = 100;        ///< most points of the last frame that are compared
  int samples = 60;        ///< of three matches, tried as the other motion
  std::uint64_t seed = 0;  ///< of the samples
  int min_matches = 8;     ///< that another motion must fit
  int min_cells = 3;       ///< of the image that it must fit
  double still = 1;        ///< px, mean shift in the image of what keeps its place
  int still_frames = 10;   ///< frames in which something keeps its place until a warning names it
  /// Of the last frames, those in which a cell has to flow by a camera that stands by its poses.
  int passing = 3;
  int passing_window = 10;
};
/// For check_options().
void describe(kys::OptionList& list, IntegrityOptions& options);

}  // namespace kys_slam
