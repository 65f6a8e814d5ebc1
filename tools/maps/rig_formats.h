// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rig.h>

#include <array>
#include <string>

namespace kys_slam {

/// A rig as other programs write it; read_stereo_rig reads all of these.

/// OpenCV's stereoCalibrate. \throws InputError for equidistant lenses, which it does not have
std::string to_opencv(const StereoRig& rig);
/// Kalibr's camchain; radial-tangential lenses need 4 coefficients there.
std::string to_kalibr(const StereoRig& rig);
/// ROS's camera_info of the left and of the right camera, rectified as StereoRectifier does.
std::array<std::string, 2> to_camera_info(const StereoRig& rig);

}  // namespace kys_slam
