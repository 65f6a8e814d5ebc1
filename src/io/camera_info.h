// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rig.h>

#include "io/calibration_file.h"

namespace kys_slam {

/// True for a file of camera_calibration, and for an echoed message.
bool is_camera_info(const CalibrationFile& file);

CameraInfo read_camera_info(const CalibrationFile& file);

}  // namespace kys_slam
