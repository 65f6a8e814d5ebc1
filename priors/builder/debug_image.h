#pragma once

#include <kys_slam/image_file.h>

#include "priors/builder/fuse.h"

namespace kys_slam {

/// A picture of one camera's stages like the paper's pipeline figure: the image with its segments,
/// predicted flow, residual, drift, decisions (Corr, Radial, Cov, Scale of each thing), exported
/// score.
RgbImage draw_stages(const GrayImage& image, const CameraFusion& fusion,
                     const FusionImages& images);

}  // namespace kys_slam
