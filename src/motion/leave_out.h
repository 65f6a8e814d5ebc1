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

/// A landmark that takes part in a frame's pose.
struct PoseTerm {
  Eigen::Vector3d p_w;  ///< m
  StereoPixel pixel;
  float weight = 1;            ///< 0..1, factor on its information
  std::int32_t instance = -1;  ///< of the thing it is on; -1: of none
};

/// A pose as an increment (plus_left()) of another in the camera's frame, [rad; m].
struct PoseIncrement {
  Vector6d delta = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();

  [[nodiscard]] Rigid3 applied_to(const Rigid3& T_c_w) const { return plus_left(T_c_w, delta); }
};

/// The pose of a frame as it would be without one of its instances: one Gauss-Newton step from the
/// pose of all terms, whose sums are kept by instance. Instances without terms leave the pose as it
/// is, with the covariance of all terms.
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
/// \param before, now increments of T_before_w and T_now_w, which judge without the instance
CameraMotion camera_motion(const Rigid3& T_before_w, const PoseIncrement& before,
                           const Rigid3& T_now_w, const PoseIncrement& now);

}  // namespace kys_slam
