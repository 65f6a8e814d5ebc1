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

/// One point of an instance, seen in an earlier frame and in the present one. Both pixels need
/// u_right.
struct InstanceMatch {
  StereoPixel before;
  StereoPixel now;
};

/// Motion of the camera between two frames, estimated without the instance that is judged.
struct CameraMotion {
  Rigid3 T_now_before;  ///< x_now = T_now_before x_before of a point that stands still
  /// Of the increment p -> exp(w) p + v in the frame of the camera now; [rotation (rad);
  /// translation (m)].
  Matrix6d covariance = Matrix6d::Zero();
};

/// How far an instance that moves may go between the two frames: standard deviations of an unknown
/// rigid motion about its centre.
struct MotionRange {
  double translation = 1;  ///< m
  double rotation = 0.1;   ///< rad
};

struct InstanceMotionOptions {
  double pixel_sigma = 0.2;      ///< px at octave 0, of a keypoint's coordinates in each frame
  double disparity_sigma = 0.2;  ///< px at octave 0, of a keypoint's disparity in each frame
  double max_chi2 = 11.3;        ///< a match says no more than this (99 %, 3 degrees of freedom)
  int min_matches = 4;           ///< below this an instance is not judged
  int iterations = 8;            ///< of each of the fits
};
/// For check_options().
void describe(kys::OptionList& list, InstanceMotionOptions& options);

/// What the matches of one instance say about its motion.
struct InstanceMotion {
  int matches = 0;  ///< usable ones
  int inliers = 0;  ///< matches that fit the motion below
  /// ln p(matches | stands still) - ln p(matches | moves by an unknown rigid motion); 0 when there
  /// are too few matches.
  double log_ratio = 0;
  /// Centre of the inliers, in the frame of the camera now, m.
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d centre_covariance = Eigen::Matrix3d::Zero();  ///< m^2
  /// The instance's own motion since the earlier frame (that of the camera is taken out), in the
  /// axes of the camera now: [rotation about the centre (rad); translation of the centre (m)].
  /// A point x of it that was at x0 = T_now_before x_before goes to c + exp(w) (x0 - c) + v, c the
  /// centre before.
  Vector6d motion = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Zero();  ///< of `motion`, the camera's share included
  bool rotation_observed = false;          ///< false: only the translation means something
};

/// Judges one instance. Both hypotheses are Gaussian priors of one rigid motion of its points
/// relative to the camera: the camera's covariance alone (stands still), or the covariance plus
/// `range` (moves). Each is fitted with residuals cut off at max_chi2, so that a few wrong matches
/// decide nothing, and the two are compared by their marginal likelihoods (README.md). A pure
/// function.
InstanceMotion estimate_instance_motion(const StereoCamera& camera,
                                        std::span<const InstanceMatch> matches,
                                        const CameraMotion& ego, const MotionRange& range,
                                        const InstanceMotionOptions& options);

}  // namespace kys_slam
