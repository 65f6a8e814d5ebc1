// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "geometry/observation.h"
#include "geometry/so3.h"
#include "motion/instance_motion.h"

namespace kys_slam {

/// A landmark used for the pose of a frame.
struct PoseTerm {
  Eigen::Vector3d p_w;  ///< m
  StereoPixel pixel;
  float weight = 1;            ///< 0..1, factor on its information
  std::int32_t instance = -1;  ///< instance it is on; -1: none
};

/// A pose as an increment (plus_left()) of another in the camera's frame, [rad; m].
struct PoseIncrement {
  Vector6d delta = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();

  [[nodiscard]] Rigid3 applied_to(const Rigid3& T_c_w) const { return plus_left(T_c_w, delta); }
};

/// The pose of a frame without the terms of one instance: one Gauss-Newton step from the pose of
/// all terms, whose sums are stored by instance. For an instance without terms the increment is
/// zero and the covariance is that of all terms.
class PoseWithout {
 public:
  PoseWithout() = default;
  PoseWithout(const StereoCamera& camera, const Rigid3& T_c_w, std::span<const PoseTerm> terms);

  [[nodiscard]] PoseIncrement without(std::int32_t instance) const;

 private:
  struct Sums {
    Matrix6d A = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
  };
  Sums all_;
  std::map<std::int32_t, Sums> of_instance_;
};

/// Motion of the camera between two frames from the poses of both.
/// \param before, now increments of T_before_w and T_now_w that leave the instance out
CameraMotion camera_motion(const Rigid3& T_before_w, const PoseIncrement& before,
                           const Rigid3& T_now_w, const PoseIncrement& now);

}  // namespace kys_slam
