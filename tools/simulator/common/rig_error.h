// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <string>

#include "simulator/common/lens.h"

namespace kys_slam::simulator {

/// How the true cameras of a rectified stereo pair differ from the given calibration. Zero error:
/// the defaults.
struct RigError {
  double focal = 1;  ///< true focal lengths / given ones; the baseline is divided by it
  std::array<double, 4> left{}, right{};  ///< k1, k2, p1, p2, as in Lens
  double yaw = 0, pitch = 0, roll = 0;    ///< rad; R_left_right = Ry(yaw) Rx(pitch) Rz(roll)
  double focal_ratio = 1;                 ///< right focal lengths / left ones
  double cx = 0, cy = 0;                  ///< px, added to the right principal point
  double baseline_y = 0, baseline_z = 0;  ///< position of the right camera / its x

  friend bool operator==(const RigError&, const RigError&) = default;
};
/// For check_options(); the keys are those of the file ("right.yaw").
void describe(kys::OptionList& list, RigError& error);

/// A YAML file, or one of these names:
/// - kitti: the error measured on KITTI's grey pairs, in px of the given width
/// - random:N: a realistic one, drawn from seed N
/// \throws InputError naming the file and what is wrong in it
RigError make_rig_error(const std::string& text, const StereoCamera& given);
/// As a YAML file that make_rig_error() reads.
std::string to_yaml(const RigError& error);

/// The true cameras of a pair, and the exact mappings between their pixels ("observed") and those
/// of the ideal rectified pair that the calibration describes ("ideal").
class TruePair {
 public:
  /// \throws InputError when the error is out of range or folds the image
  TruePair(const StereoCamera& given, const RigError& error);

  [[nodiscard]] const Lens& left() const { return left_; }
  [[nodiscard]] const Lens& right() const { return right_; }
  [[nodiscard]] const Rigid3& T_left_right() const { return T_left_right_; }

  /// Observed (u, v, u_right, v_right) px of a point (m) in the left camera frame, in front of both
  /// cameras.
  [[nodiscard]] Eigen::Vector4d observe(const Eigen::Vector3d& p_c) const;
  /// Ideal pixel of an observed pixel of the left image.
  [[nodiscard]] Eigen::Vector2d left_ideal(double u, double v) const;
  /// The same of the right image, for a point at infinity.
  [[nodiscard]] Eigen::Vector2d right_ideal_far(double u, double v) const;

  struct IdealPair {
    double u = 0, v = 0;        ///< px, in the ideal left image
    double u_right = 0;         ///< px, in the ideal right image
    double row_difference = 0;  ///< px, ideal right row - left row; 0 for pixels of one point
  };
  /// Ideal pixels of two observed ones, with the depth at which their rays meet in x.
  [[nodiscard]] IdealPair pair_ideal(double u, double v, double u_right, double v_right) const;

 private:
  /// Direction (x, y, 1) through an observed pixel of the right image, in left axes.
  [[nodiscard]] Eigen::Vector2d right_ray(double u, double v) const;

  StereoCamera given_;
  Lens left_, right_;
  double baseline_y_, baseline_z_;
  Rigid3 T_left_right_;
};

}  // namespace kys_slam::simulator
