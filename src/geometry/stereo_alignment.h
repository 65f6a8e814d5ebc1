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

/// A landmark of keyframe a taken to be the same as one of keyframe b.
struct PointMatch {
  Eigen::Vector3d p_a;  ///< m, frame of camera a
  Eigen::Vector3d p_b;  ///< m, frame of camera b
  StereoPixel pixel_a;  ///< where camera a sees it
  StereoPixel pixel_b;  ///< where camera b sees it
};

struct RansacOptions {
  std::uint64_t seed = 0;
  int iterations = 300;       ///< at most; fewer as soon as `confidence` is reached
  double confidence = 0.999;  ///< of having met a sample without outliers
  int min_inliers = 10;       ///< fewer is no success
  double chi2_mono = kChi2Mono99;
  double chi2_stereo = kChi2Stereo99;
};
/// For check_options().
void describe(kys::OptionList& list, RansacOptions& options);

/// What a RANSAC over matches found. Without success T is the identity and there is no inlier.
struct RansacResult {
  bool success = false;
  Rigid3 T;
  std::vector<std::uint8_t> inlier;  ///< per match
  int inliers = 0;
  int iterations = 0;
};

/// T_a_b between two keyframes from matched landmarks, for closing loops over SE(3): samples of
/// three (Horn's solution), inliers by the reprojection error in both cameras (the landmark of each
/// seen by the other; ORB-SLAM Sec. VII-B without scale), refined over both errors. A landmark is
/// taken to be as uncertain as its stereo pixel makes it, which matters for far ones seen from
/// places apart. Monocular pixels are tested in the left image alone. Same seed, same answer.
RansacResult align_se3_ransac(const StereoCamera& camera, std::span<const PointMatch> matches,
                              const RansacOptions& options);

}  // namespace kys_slam
