// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/chi_square.h"
#include "geometry/observation.h"

namespace kys_slam {

/// A landmark of keyframe a matched to a landmark of keyframe b.
struct PointMatch {
  Eigen::Vector3d p_a;  ///< m, frame of camera a
  Eigen::Vector3d p_b;  ///< m, frame of camera b
  StereoPixel pixel_a;  ///< where camera a sees it
  StereoPixel pixel_b;  ///< where camera b sees it
};

struct RansacOptions {
  std::uint64_t seed = 0;
  int iterations = 300;       ///< largest number; fewer when `confidence` is reached
  double confidence = 0.999;  ///< probability of a sample without outliers
  int min_inliers = 10;       ///< with fewer, no success
  double chi2_mono = kChi2Mono99;
  double chi2_stereo = kChi2Stereo99;
};
/// For check_options().
void describe(kys::OptionList& list, RansacOptions& options);

/// Result of RANSAC over matches. Without success T is the identity and there are no inliers.
struct RansacResult {
  bool success = false;
  Rigid3 T;
  std::vector<std::uint8_t> inlier;  ///< per match
  int inliers = 0;
  int iterations = 0;
};

/// T_a_b between two keyframes from matched landmarks, to close loops over SE(3): samples of three
/// (Horn's solution), inliers by the reprojection error in both cameras (ORB-SLAM Sec. VII-B
/// without scale), refinement over both errors. The uncertainty of a landmark is that of its stereo
/// pixel, which matters for far landmarks. Monocular pixels are tested in the left image only. The
/// same seed gives the same result.
RansacResult align_se3_ransac(const StereoCamera& camera, std::span<const PointMatch> matches,
                              const RansacOptions& options);

}  // namespace kys_slam
