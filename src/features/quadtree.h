// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "features/corner_detector.h"

namespace kys_slam {

/// Distributes corners over the image (ORB-SLAM, quadtree): nearly square cells are split in four
/// until `wanted` cells hold a corner. When not all cells can be split, those with most corners are
/// split first. The strongest corner of every cell is kept. Returns at most three more than
/// `wanted`, in the order of the tree. The result does not depend on the order of the input.
std::vector<Corner> distribute(const std::vector<Corner>& corners, int min_x, int max_x, int min_y,
                               int max_y, int wanted);

}  // namespace kys_slam
