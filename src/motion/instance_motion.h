// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <span>

#include "geometry/observation.h"

namespace kys_slam {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// One point of an instance, observed in an earlier frame and in the present one. Both pixels need
/// u_right.
struct InstanceMatch {
  StereoPixel before;
  StereoPixel now;
};

/// Motion of the camera between two frames, estimated without the tested instance.
struct CameraMotion {
  Rigid3 T_now_before;  ///< x_now = T_now_before x_before of a static point
  /// Covariance of the increment p -> exp(w) p + v in the frame of the camera now; [rotation (rad);
  /// translation (m)].
  Matrix6d covariance = Matrix6d::Zero();
};

/// Prior of the motion of a moving instance between the two frames: standard deviations of a rigid
/// motion about its centre.
struct MotionRange {
  double translation = 1;  ///< m
  double rotation = 0.1;   ///< rad
};

struct InstanceMotionOptions {
  /// px at octave 0, of a keypoint's coordinates, and of its disparity, in each frame; half of it
  /// for keypoints aligned with the patch of their landmark (kAlignedSigma over kPixelSigma)
  double pixel_sigma = 0.2;
  double disparity_sigma = 0.2;
  double max_chi2 = 11.3;  ///< limit of the chi-square of a match (99 %, 3 degrees of freedom)
  int min_matches = 4;     ///< with fewer, an instance is not tested
  int iterations = 8;      ///< of each of the fits
};
/// For check_options().
void describe(kys::OptionList& list, InstanceMotionOptions& options);

/// Motion of one instance, estimated from its matches.
struct InstanceMotion {
  int matches = 0;  ///< usable ones
  int inliers = 0;  ///< matches that fit the motion below
  /// ln p(matches | static) - ln p(matches | unknown rigid motion), nats; 0 with too few matches.
  double log_ratio = 0;
  /// Centre of the inliers, in the frame of the camera now, m.
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d centre_covariance = Eigen::Matrix3d::Zero();  ///< m^2
  /// The motion of the instance relative to the world since the earlier frame, in the axes of the
  /// camera now: [rotation about the centre (rad); translation of the centre (m)]. A point of it at
  /// x0 = T_now_before x_before moves to c + exp(w) (x0 - c) + v, c the centre before.
  Vector6d motion = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();  ///< of `motion`, the uncertainty of the camera included
  bool rotation_observed = false;          ///< false: only the translation is meaningful
};

/// Tests whether one instance is static. Both hypotheses are Gaussian priors of the rigid motion of
/// its points relative to the camera: the covariance of the camera (static), or this covariance
/// plus `range` (moving). Each is fitted with residuals truncated at max_chi2, so that a few wrong
/// matches do not decide. The two are compared by their marginal likelihoods (README.md). A pure
/// function.
InstanceMotion estimate_instance_motion(const StereoCamera& camera,
                                        std::span<const InstanceMatch> matches,
                                        const CameraMotion& ego, const MotionRange& range,
                                        const InstanceMotionOptions& options);

}  // namespace kys_slam
