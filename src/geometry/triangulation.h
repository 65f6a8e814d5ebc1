#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

namespace kys_slam {

/// A point seen by two cameras, and what a mapper asks before it believes in it.
struct TwoViewPoint {
  bool valid = false;       ///< finite, and in front of both cameras
  Eigen::Vector3d p_a;      ///< m, frame of camera a
  double cos_parallax = 1;  ///< cosine of the angle between the two rays; set also if not valid
  double error_a = 0;       ///< px, reprojection error in camera a
  double error_b = 0;       ///< px, in camera b
};

/// Cosine of the angle between the rays of left pixel `x_a` of camera a and `x_b` of camera b.
double ray_parallax_cosine(const StereoCamera& camera, const Rigid3& T_a_b,
                           const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b);

/// Point whose left images are `x_a` and `x_b` (px): midpoint of the rays (Hartley and Sturm 1997),
/// then a few Gauss-Newton steps on the reprojection errors, each over its deviation (px). Rays
/// that are parallel to 1e-7 rad are not valid.
TwoViewPoint triangulate(const StereoCamera& camera, const Rigid3& T_a_b,
                         const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b,
                         double sigma_a = 1.0, double sigma_b = 1.0);

}  // namespace kys_slam
