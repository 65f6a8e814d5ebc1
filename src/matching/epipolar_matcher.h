// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam {

/// Pair of feature indices of two keyframes.
struct FeaturePair {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
};

struct EpipolarOptions {
  float max_distance = 50;      ///< bits
  float chi2_line = 3.841f;     ///< 95 %, 1 degree of freedom: distance to the epipolar line
  float min_depth = 1;          ///< m, nearest depth searched along a line
  float max_depth = 300;        ///< m, farthest (features without stereo match of their own)
  float depth_sigma_px = 1.0f;  ///< px, standard deviation of a disparity: bounds the search
};
/// For check_options().
void describe(kys::OptionList& list, EpipolarOptions& options);

/// Matches features without a landmark of keyframe a to those of keyframe b along their epipolar
/// lines (ORB-SLAM, Sec. VI-C). For a stereo feature only the epipolar segment that its depth
/// allows is searched.
/// \param free_a, free_b one flag per feature, 1: no landmark
/// \param T_b_a from the camera of a to that of b
std::vector<FeaturePair> match_epipolar(
    const StereoCamera& camera, const ScaleLevels& scales, const FrameFeatures& a,
    std::span<const std::uint8_t> free_a, const FrameFeatures& b,
    std::span<const std::uint8_t> free_b, const Rigid3& T_b_a, const EpipolarOptions& options,
    const kys::DistanceModel& model, kys::Statistics& statistics);

}  // namespace kys_slam
