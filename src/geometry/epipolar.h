#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cmath>
#include <limits>

namespace kys_slam {

/// Epipolar lines in the left image of camera b of pixels in the left image of camera a.
class EpipolarGeometry {
 public:
  EpipolarGeometry(const StereoCamera& camera, const Rigid3& T_b_a) {
    Eigen::Matrix3d K_inverse;
    K_inverse << 1 / camera.fx, 0, -camera.cx / camera.fx,  //
        0, 1 / camera.fy, -camera.cy / camera.fy,           //
        0, 0, 1;
    F_b_a_ = K_inverse.transpose() * hat(T_b_a.t()) * T_b_a.R() * K_inverse;
    epipole_b_ = T_b_a.t();
    camera_ = camera;
  }

  /// Line (n_x, n_y, d) in image b, |n| = 1, on which the match of `x_a` (px) has to lie. Not
  /// finite if there is none: cameras in one place, or `x_a` is the epipole.
  [[nodiscard]] Eigen::Vector3d line(const Eigen::Vector2d& x_a) const {
    const Eigen::Vector3d l = F_b_a_ * x_a.homogeneous();
    return l / std::hypot(l.x(), l.y());
  }
  /// Distance of `x_b` from a line, px; infinity if there is no line.
  [[nodiscard]] static double line_distance(const Eigen::Vector3d& line,
                                            const Eigen::Vector2d& x_b) {
    const double d = std::abs(line.dot(x_b.homogeneous()));
    return std::isfinite(d) ? d : std::numeric_limits<double>::infinity();
  }
  [[nodiscard]] double distance(const Eigen::Vector2d& x_a, const Eigen::Vector2d& x_b) const {
    return line_distance(line(x_a), x_b);
  }
  /// Where camera a's centre appears in image b; matches near it have next to no parallax. Not
  /// finite if camera a is beside camera b.
  [[nodiscard]] Eigen::Vector2d epipole() const { return camera_.project(epipole_b_); }
  /// x_b^T F x_a = 0 in homogeneous pixels.
  [[nodiscard]] const Eigen::Matrix3d& fundamental() const { return F_b_a_; }

 private:
  StereoCamera camera_;
  Eigen::Matrix3d F_b_a_;
  Eigen::Vector3d epipole_b_;
};

}  // namespace kys_slam
