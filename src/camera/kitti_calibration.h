// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <string>

namespace kys_slam {

using ProjectionMatrix = Eigen::Matrix<double, 3, 4>;

/// The rectified pair of two KITTI projection matrices, P = K [I | t] with the same K:
/// baseline = (P_left(0,3) - P_right(0,3)) / fx.
/// \param name of the calibration file, for messages
/// \throws InputError when a number is not finite, a focal length or the baseline is not positive,
///   or the two matrices are not a rectified pair.
StereoCamera stereo_camera_from_projections(const ProjectionMatrix& P_left,
                                            const ProjectionMatrix& P_right, int width, int height,
                                            const std::string& name);

}  // namespace kys_slam
