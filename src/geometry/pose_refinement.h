// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <span>

#include "geometry/observation.h"

namespace kys_slam {

/// A point of frame `b` observed by camera `a`, or the reverse if `inverse`.
struct ReprojectionTerm {
  Eigen::Vector3d point;  ///< m; in frame b, or in frame a if `inverse`
  StereoPixel pixel;      ///< in camera a, or in camera b if `inverse`
  bool inverse = false;
  /// m^2, of `point` in its frame; widens the test where depth is uncertain. Zero: exact.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// Covariance (m^2) of a point (m, camera frame) measured by a stereo pixel; zero for a monocular
/// pixel, which does not measure depth.
Eigen::Matrix3d stereo_covariance(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                                  const StereoPixel& pixel);

/// Squared Mahalanobis distance of a term at `T_a_b`, with the covariances of pixel and point;
/// infinity for a point behind the camera.
double reprojection_chi2(const StereoCamera& camera, const Rigid3& T_a_b,
                         const ReprojectionTerm& term);

/// Minimises the sum of chi2 from `T_a_b`. Returns the pose with the least sum found. Covariances
/// are those at the initial pose.
Rigid3 refine_pose(const StereoCamera& camera, const Rigid3& T_a_b,
                   std::span<const ReprojectionTerm> terms, int iterations);

}  // namespace kys_slam
