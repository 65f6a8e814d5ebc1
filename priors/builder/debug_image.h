// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_file.h>

#include "priors/fusion/fuse.h"

namespace kys_slam {

/// An image of the stages of one camera, like the pipeline figure of the paper: the input image
/// with its segments, predicted flow, residual, drift, decisions (Corr, Radial, Cov, Scale of each
/// thing), exported score.
RgbImage draw_stages(const GrayImage& image, const CameraFusion& fusion,
                     const FusionImages& images);

}  // namespace kys_slam
