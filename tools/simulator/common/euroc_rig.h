// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rectifier.h>

#include <string>

#include "simulator/common/lens.h"

namespace kys_slam::simulator {

inline constexpr int kEurocWidth = 752;   // px
inline constexpr int kEurocHeight = 480;  // px

/// Intrinsics of EuRoC's two cameras (the same in all its sequences), scaled to a size.
Lens euroc_lens(int camera, int width = kEurocWidth, int height = kEurocHeight);
/// Both cameras, rectified as the reader of EuRoC sequences does.
StereoRectifier euroc_rectifier(int width = kEurocWidth, int height = kEurocHeight);
/// T_body_camera.
Rigid3 euroc_extrinsics(int camera);
/// The same as the data set's sensor.yaml.
std::string euroc_sensor_yaml(int camera, int width, int height);

}  // namespace kys_slam::simulator
