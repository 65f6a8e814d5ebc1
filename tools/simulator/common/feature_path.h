// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>
#include <kys_slam/stereo_camera.h>

#include <filesystem>
#include <vector>

#include "simulator/common/feature_options.h"

namespace kys_slam::simulator {

/// The camera and its path.
struct FeaturePath {
  StereoCamera camera;
  std::vector<TimedPose> poses;  ///< of the left camera
  double near = 4, far = 60;     ///< m
  double ground = 0;             ///< m below the camera; 0: none
  int features = 1200;           ///< per image
};

/// Reads a KITTI (12 columns) or TUM (8 columns) trajectory. With camera euroc a TUM file gives the
/// body frame, as EuRoC's ground truth does. Every N-th pose is used, N >= 1, such that the time
/// between two is nearest to 1 / `frame_rate`; `every` counts in the poses that are left.
/// \throws InputError naming file and line (missing, not finite, stamps that do not increase).
FeaturePath read_feature_path(const std::filesystem::path& trajectory,
                              const FeatureOptions& options);

}  // namespace kys_slam::simulator
