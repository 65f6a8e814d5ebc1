#pragma once

#include <kys_slam/stereo_camera.h>

#include <string>

namespace kys_slam {

/// What is not plausible, or "": a focal length (px) far from the image size, a principal point far
/// outside the image, a baseline above 1 km.
std::string implausible_camera(const StereoCamera& camera);

}  // namespace kys_slam
