// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <optional>
#include <vector>

#include "priors/fusion/depth.h"
#include "priors/fusion/flow_row.h"
#include "priors/fusion/options.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// The flow a static scene has in one camera between frame t and t+1 (Eq. 6).
struct EgoMotion {
  EgoMotionModel model = EgoMotionModel::kSe3;
  StereoCamera camera;        ///< intrinsics of this camera (both have the same)
  Rigid3 T_next_now;          ///< kSe3: this camera's motion
  std::array<double, 8> c{};  ///< kRigid, kAsPrinted: c1..c8
  int samples = 0;            ///< pixels used
  double mean_residual = 0;   ///< px, over the samples, after the fit

  /// The predicted flow along row y.
  [[nodiscard]] FlowRow flow_row(int y) const;
  /// Predicted flow (px) of row y from its inverse depths (1/m); NaN where these are.
  void predict_row(int y, const float* inverse_depth, float* u, float* v) const;
};

/// Fits the static-scene flow to the stuff pixels by iteratively re-weighted least squares with
/// Huber weights on the length of the residual in px. Nothing when there are fewer than
/// `min_samples` usable pixels.
/// \param is_stuff by segment number, [0] (void) is false.
std::optional<EgoMotion> fit_ego_motion(const BuilderOptions::EgoMotion& options,
                                        const StereoCamera& camera, const FlowField& flow,
                                        const ImageOf<float>& disparity,
                                        const InverseDepth& inverse_depth,
                                        const ImageOf<std::uint16_t>& segment_map,
                                        const std::vector<std::uint8_t>& is_stuff);

}  // namespace kys_slam
