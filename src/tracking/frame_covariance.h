// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "geometry/observation.h"
#include "map/replica.h"
#include "optimization/pose_covariance.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

/// Covariances of the pose of each tracked frame: relative to its reference keyframe, and relative
/// to the tracked frame before. It remembers that frame. The derivation and the noise model are in
/// docs/pose_quality.md.
class FrameCovariance {
 public:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  /// An inlier of the accepted pose.
  struct Seen {
    LandmarkId landmark;
    StereoPixel pixel;  ///< with the weight that it has in the pose optimisation
    float share = 1;    ///< factor on its information
    float own = 1;      ///< variance of the pixel alone, by that of `pixel`
  };
  struct Frame {
    Rigid3 T_c_w;
    KeyFrameId reference;
    std::optional<PosePrior> held;
    std::span<const Seen> seen;
    Rigid3 T_before_w;  ///< of the frame before as the map is now
    KeyFrameId before;  ///< the keyframe that the frame before became; invalid: none
  };
  struct Result {
    Matrix6d pose;
    std::optional<Matrix6d> motion;
  };

  FrameCovariance(const StereoCamera& camera, const ScaleLevels& scales)
      : camera_(camera), scales_(scales) {}

  /// The covariances of the next tracked frame, of increments [w; v] (rad, m) on the right of
  /// T_reference_c and T_before_c, which is in the frame of the camera.
  Result update(const Replica& replica, const Frame& frame);
  /// What is known of the rig when it was corrected.
  void set_rig(const RigSigma& rig) { rig_ = rig; }
  /// The next frame has no frame before it.
  void forget() { before_.reset(); }
  /// What the frames said of the noise: its variance by the assumed one.
  [[nodiscard]] double noise() const { return noise_; }

 private:
  struct Weight {
    LandmarkId landmark;
    Eigen::Matrix3d weight;  // 1/m^2, in the frame of the camera
  };
  struct Before {
    std::vector<Weight> weights;
    Matrix6d noise, prior;  // in the frame of its camera
    std::optional<Matrix6d> motion;
  };
  struct Keyframe {
    KeyFrameId id;
    Rigid3 T_k_c;
    Eigen::Matrix3d R;
  };

  void add_seen(const Replica& replica, const Frame& frame, PoseCovarianceProblem& problem) const;
  void add_before(const Replica& replica, const Frame& frame, std::vector<LandmarkId>& ids,
                  PoseCovarianceProblem& problem) const;
  void choose_keyframes(const Replica& replica, const Frame& frame,
                        std::span<const LandmarkId> landmarks);
  void add_views(const Replica& replica, std::span<const LandmarkId> ids,
                 PoseCovarianceProblem& problem);
  [[nodiscard]] double measure_noise(const Frame& frame, const PoseCovarianceProblem& problem,
                                     const PoseCovarianceResult& found) const;

  StereoCamera camera_;
  ScaleLevels scales_;
  RigSigma rig_;
  double noise_ = 1;
  int frames_ = 0;  // of which the noise is known
  std::optional<Before> before_;
  // Of the frame being computed.
  std::vector<Keyframe> keyframes_;
  std::vector<std::uint16_t> count_;  // landmarks by keyframe id; zero between frames
  std::vector<std::int16_t> slot_;    // index in keyframes_ by keyframe id, -1: none
  std::vector<std::int32_t> place_;   // of a landmark in the problem, by its id; -1 between frames
};

}  // namespace kys_slam
