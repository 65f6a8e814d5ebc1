#pragma once

#include <array>

#include "geometry/stereo_alignment.h"

namespace kys_slam {

/// A landmark of known position taken to be seen at a pixel.
struct PnpMatch {
  Eigen::Vector3d p_w;  ///< m, world frame
  StereoPixel pixel;
};

/// Poses T_c_w that see three points along three rays (Grunert's quartic as in Haralick et al.,
/// IJCV 1994), at most four. `rays` are unit vectors in the camera frame, `points` in the world
/// frame (m).
std::vector<Rigid3> solve_p3p(const std::array<Eigen::Vector3d, 3>& rays,
                              const std::array<Eigen::Vector3d, 3>& points);

/// T_c_w of a camera from landmarks (relocalisation): samples of three by P3P, inliers by the
/// reprojection error (three rows where the right image saw the point too), refined over the
/// inliers. Same seed, same answer.
RansacResult solve_pnp_ransac(const StereoCamera& camera, std::span<const PnpMatch> matches,
                              const RansacOptions& options);

}  // namespace kys_slam
