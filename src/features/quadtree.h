#pragma once

#include <vector>

#include "features/corner_detector.h"

namespace kys_slam {

/// Spreads corners over the image (ORB-SLAM, quadtree distribution): cells are split in four until
/// there are `wanted` of them or each holds one corner; the best corner of every cell stays, in the
/// order of the cells. Returns at most about `wanted` corners (a few more when the last split makes
/// several). The result does not depend on the order of equal corners in memory, only on the list.
std::vector<Corner> distribute(const std::vector<Corner>& corners, int min_x, int max_x, int min_y,
                               int max_y, int wanted);

}  // namespace kys_slam
