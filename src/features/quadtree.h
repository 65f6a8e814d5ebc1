#pragma once

#include <vector>

#include "features/corner_detector.h"

namespace kys_slam {

/// Spreads corners over the image (ORB-SLAM, quadtree distribution): square-like cells are split in
/// four until there are `wanted` that hold a corner, the fullest first when not all can be split
/// any more; the strongest corner of every cell stays. Returns at most three more than `wanted`, in
/// the order of the tree. The result does not depend on the order of the input.
std::vector<Corner> distribute(const std::vector<Corner>& corners, int min_x, int max_x, int min_y,
                               int max_y, int wanted);

}  // namespace kys_slam
