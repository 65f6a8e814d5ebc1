#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "features/pyramid.h"
#include "matching/patch_kernels.h"

namespace kys_slam {

/// What a landmark looks like in the keyframe that fixes where on the surface it lies: the 17x17
/// pixels of the keypoint's octave around the keypoint, which is at the centre.
struct LandmarkPatch {
  std::array<std::uint8_t, patch::kPatchBytes> pixels{};  ///< row-major
};

/// The patch around (u, v), px of the full image, at an octave; nothing close to the border.
std::optional<LandmarkPatch> cut_patch(const ImagePyramid& pyramid, int octave, float u, float v);

/// Where a patch's centre lies in another image.
struct PatchPosition {
  float u = 0;         ///< px of the full image
  float v = 0;         ///< px of the full image
  float residual = 0;  ///< grey levels, weighted root mean square
};

/// Aligns the inner part of a patch with an image, from (u, v) (px of the full image) on and not
/// beyond 1.5 px of the octave from it: least squares of the grey differences with their mean
/// removed, over the place of the centre alone (Lucas and Kanade, 1981, in the inverse form of
/// Baker and Matthews, 2004). Corners are found anew in every image, to a third of a pixel; their
/// surroundings repeat to a tenth. Pixels count the less the further from the centre they are, and
/// the less they fit, as those of another surface.
/// \param warp  px of the octave per px of the patch: how the patch is turned and stretched
/// \return nothing close to the border, where the patch is stretched by more than it has pixels
/// for,
///   without contrast in both directions, or when it strays.
std::optional<PatchPosition> align_corner(const LandmarkPatch& patch, const Eigen::Matrix2f& warp,
                                          const ImagePyramid& pyramid, int octave, float u,
                                          float v);

}  // namespace kys_slam
