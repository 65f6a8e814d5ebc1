#pragma once

#include <kys_slam/stereo_rectifier.h>

#include <filesystem>

namespace kys_slam {

/// Camera calibration in the ASL format (EuRoC's sensor.yaml): T_BS (4x4, camera to body),
/// resolution, intrinsics, radial-tangential distortion.
/// \throws InputError naming the file and the key that is missing, malformed or not finite.
RawCamera read_sensor_yaml(const std::filesystem::path& path);

}  // namespace kys_slam
