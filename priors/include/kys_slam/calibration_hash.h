// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>

namespace kys_slam {

/// Identifies the rectified stereo geometry priors were made for: 64-bit FNV-1a over seven 64-bit
/// little-endian integers: width, height (px), round(1e4 fx), round(1e4 fy), round(1e4 cx),
/// round(1e4 cy) (px), round(1e7 baseline) (m). Never 0 (0 means "any calibration" in a file).
std::uint64_t calibration_hash(const StereoCamera& camera);

}  // namespace kys_slam
