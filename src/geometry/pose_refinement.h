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
};

/// chi2 of a term at `T_a_b`; infinity for a point behind the camera.
double reprojection_chi2(const StereoCamera& camera, const Rigid3& T_a_b,
                         const ReprojectionTerm& term);

/// Least sum of chi2 by Gauss-Newton from `T_a_b`, keeping the best pose met.
Rigid3 refine_pose(const StereoCamera& camera, const Rigid3& T_a_b,
                   std::span<const ReprojectionTerm> terms, int iterations);

}  // namespace kys_slam
