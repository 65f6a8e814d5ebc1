// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rig.h>

#include "io/calibration_file.h"

namespace kys_slam {

/// Whether a file is one of the settings files that users of ORB-SLAM2 and ORB-SLAM3 have
/// (`Camera.fx`, `Camera1.fx`, ...).
bool is_orb_slam_settings(const CalibrationFile& file);

/// The cameras of such a file; what is not about cameras is not read. ORB-SLAM3: `Camera.type`
/// PinHole or KannalaBrandt8 with `Stereo.T_c1_c2`, or Rectified with `Stereo.b`. ORB-SLAM2:
/// `LEFT.K` and the like as in ROS, or a rectified pair with `Camera.bf`.
/// \param unit metres per unit of length
/// \throws InputError naming the file and what is missing
StereoRig read_orb_slam_settings(const CalibrationFile& file, double unit);

}  // namespace kys_slam
