// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>
#include <kys_slam/stereo_rig.h>

namespace kys_slam {

/// Two cameras of a usual model that measure what a corrected pair measures.
struct FittedRig {
  StereoRig rig;
  double largest = 0;  ///< px, of residuals over the images
  double rms = 0;      ///< px, of both coordinates
};

/// Fits focal lengths, principal points, lenses and the relative pose of both cameras, by least
/// squares over a grid of pixels and distances. The lens model is that of `given`.
/// \param given the rig that the correction is for, raw or rectified
/// \param rectified its rectified pair
/// \param coefficients of a radial-tangential lens: 4 (k1 k2 p1 p2) or 5 (and k3)
FittedRig fit_rig(const StereoRig& given, const StereoCamera& rectified,
                  const RigCorrection& correction, int coefficients = 5);

}  // namespace kys_slam
