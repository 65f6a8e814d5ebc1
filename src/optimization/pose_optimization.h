// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "geometry/chi_square.h"
#include "geometry/observation.h"

namespace kys_slam {

/// Observation of a landmark of known position in one frame.
struct PoseObservation {
  Eigen::Vector3d p_w;  ///< m, world frame
  float u = 0;          ///< px, left image
  float v = 0;          ///< px
  float u_right = 0;    ///< px, right image; NaN for a monocular observation
  float inv_sigma = 1;  ///< 1/px, inverse standard deviation of u (ScaleLevels::inv_sigma)
  float share = 1;      ///< 0..1, factor on its information; chi-square bounds do not depend on it
  InformationRatio ratio = {};
};

/// Gaussian prior of the pose, an additional term of the cost.
struct PosePrior {
  Rigid3 T_c_w;
  double sigma_position = 1;  ///< m, of the camera centre
  double sigma_rotation = 1;  ///< rad
};

struct PoseOptions {
  int rounds = 4;       ///< outliers are reclassified after each
  int iterations = 10;  ///< per round, at most
  double chi2_mono = kChi2Mono95;
  double chi2_stereo = kChi2Stereo95;
  std::optional<PosePrior> prior;
};
/// For check_options().
void describe(kys::OptionList& list, PoseOptions& options);

struct PoseResult {
  Rigid3 T_c_w;
  std::vector<std::uint8_t> outlier;  ///< per observation, 1 = outlier
  int inliers = 0;
  /// J^T W J at the solution, [rotation; translation]; the prior's share included
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
};

struct ObservationLanes;

/// The errors of the observations of a frame, evaluated for many poses.
class PoseErrors {
 public:
  PoseErrors(const StereoCamera& camera, std::span<const PoseObservation> observations,
             const PoseOptions& options);

  /// Per observation its chi-square divided by its bound; infinite for a point behind the camera
  /// and for an observation that is not finite.
  void at(const Rigid3& T_c_w, std::vector<double>& errors) const;

 private:
  StereoCamera camera_;
  std::size_t count_;
  std::shared_ptr<const std::vector<ObservationLanes>> lanes_;
};

/// Pose of a frame from landmarks of fixed position: Huber-weighted reprojection error, outliers
/// reclassified between rounds (ORB-SLAM2, Sec. III-C "motion-only BA"). A point behind the camera
/// is an outlier. With fewer than three usable observations the initial pose is returned and every
/// observation is an outlier.
PoseResult optimize_pose(const StereoCamera& camera, const Rigid3& T_c_w_initial,
                         std::span<const PoseObservation> observations,
                         const PoseOptions& options = {});

/// Standard deviation of the camera centre in its least certain direction, m; infinite when that
/// direction is not observed.
double position_sigma(const PoseResult& pose);

}  // namespace kys_slam
