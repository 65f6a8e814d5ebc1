// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#include "simulator/common/feature_path.h"

namespace kys_slam::simulator {

/// T_w_o of an object in a frame, or null when it does not exist in that frame.
const Rigid3* pose_in_frame(const FeatureObject& object, std::size_t frame);

/// Position (m) of a landmark in the frame of its object at a time (s): people oscillate.
Eigen::Vector3d sway(const FeatureObject& object, const Eigen::Vector3d& p_o, double time);

}  // namespace kys_slam::simulator
