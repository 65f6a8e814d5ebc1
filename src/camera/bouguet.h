// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_rectifier.h>

#include <array>
#include <optional>

namespace kys_slam {

/// Rotations of Bouguet's rectification: each camera turns by half of the rotation between them,
/// then both turn, by the least angle, until the baseline is along x.
struct RectifyingRotations {
  std::array<Eigen::Matrix3d, 2> R_rectified_raw;  ///< left, right
  Eigen::Vector3d shift;  ///< origin of the left camera in the right one, rectified, m
};
/// Nothing when the cameras stand rather one above the other, or at the same place.
std::optional<RectifyingRotations> rectifying_rotations(const Rigid3& T_r_l);

/// What both rectified images share, px.
struct RectifiedIntrinsics {
  double f = 0, cx = 0, cy = 0;
};
/// Of two radial-tangential cameras of one size: the mean vertical focal length, the principal
/// point at which both images are on average in the middle, scaled until every pixel of the result
/// lies inside the raw images (OpenCV's stereoRectify() with CALIB_ZERO_DISPARITY and alpha 0).
RectifiedIntrinsics fitting_intrinsics(const RawCamera& left, const RawCamera& right,
                                       const RectifyingRotations& rotations);

}  // namespace kys_slam
