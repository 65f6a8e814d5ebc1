#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <span>

#include "geometry/observation.h"

namespace kys_slam {

/// A point of frame `b` seen by camera `a`, or the other way about.
struct ReprojectionTerm {
  Eigen::Vector3d point;  ///< m; in frame b, or in frame a if `inverse`
  StereoPixel pixel;      ///< in camera a, or in camera b if `inverse`
  bool inverse = false;
  /// m^2, of `point` in its frame: makes the test wider where depth is poorly known. Zero: exact.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// Covariance (m^2) of a point of the camera frame that a stereo pixel of the given accuracy
/// measured; zero for a monocular pixel, which says nothing about depth.
Eigen::Matrix3d stereo_covariance(const StereoCamera& camera, const Eigen::Vector3d& p_c,
                                  const StereoPixel& pixel);

/// Squared error of a term at `T_a_b` over the covariance of pixel and point together; infinity for
/// a point behind the camera.
double reprojection_chi2(const StereoCamera& camera, const Rigid3& T_a_b,
                         const ReprojectionTerm& term);

/// Least sum of chi2 by Gauss-Newton from `T_a_b`, keeping the best pose met. Covariances are those
/// at the start.
Rigid3 refine_pose(const StereoCamera& camera, const Rigid3& T_a_b,
                   std::span<const ReprojectionTerm> terms, int iterations);

}  // namespace kys_slam
