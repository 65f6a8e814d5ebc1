// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rig.h>

#include <filesystem>
#include <string>

namespace kys_slam {

/// "1241x376 px, fx 718.856, ..."
std::string describe(const StereoCamera& camera);

/// The calibration that maps were made with, as it goes into a file with its correction.
/// \param from file of the raw cameras; empty: images were rectified, by `camera`
/// \param unit m per unit of its lengths
/// \throws InputError when `from` is no calibration, or not that of `camera`
StereoRig given_rig(const std::filesystem::path& from, double unit, const StereoCamera& camera);

}  // namespace kys_slam
