// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <string>

namespace kys_slam {

/// \throws InputError "NAME: what is not plausible": a focal length (px) far from the image size, a
/// principal point far outside the image, a baseline above 1 km.
void require_plausible(const StereoCamera& camera, const std::string& name);

}  // namespace kys_slam
