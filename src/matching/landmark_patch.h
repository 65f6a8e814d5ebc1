// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "features/pyramid.h"
#include "matching/patch_kernels.h"

namespace kys_slam {

/// The image patch of a landmark in the keyframe that defines its position on the surface: 17x17 px
/// of the keypoint's octave, centred on the keypoint.
struct LandmarkPatch {
  std::array<std::uint8_t, patch::kPatchBytes> pixels{};  ///< row-major
};

/// The patch around (u, v), px of the full image, at an octave; nothing close to the border.
std::optional<LandmarkPatch> cut_patch(const ImagePyramid& pyramid, int octave, float u, float v);

/// Position of a patch's centre in another image.
struct PatchPosition {
  float u = 0;         ///< px of the full image
  float v = 0;         ///< px of the full image
  float residual = 0;  ///< grey levels, weighted root mean square
};

/// Aligns the inner part of a patch with an image, starting at (u, v) (px of the full image),
/// within 1.5 px of the octave. Least squares of the grey differences with their mean removed, over
/// the position of the centre (Lucas and Kanade, 1981, in the inverse form of Baker and Matthews,
/// 2004). A detected corner repeats to 0.3 px, an aligned patch to 0.1 px. Weights fall with the
/// distance from the centre and with the residual, for pixels of another surface.
/// \param warp px of the octave per px of the patch: rotation and scale of the patch
/// \return nothing close to the border, where the warp leaves the patch, without contrast in both
///   directions, or when it does not converge within 1.5 px
std::optional<PatchPosition> align_corner(const LandmarkPatch& patch, const Eigen::Matrix2f& warp,
                                          const ImagePyramid& pyramid, int octave, float u,
                                          float v);

}  // namespace kys_slam
