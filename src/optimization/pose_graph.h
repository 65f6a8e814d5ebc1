// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>

#include <atomic>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// A measured relative pose of two keyframes: T_a_b.
struct PoseGraphEdge {
  std::int32_t a = 0;
  std::int32_t b = 0;
  Rigid3 T_a_b;
  double weight = 1;  ///< multiplies the residual
};

struct PoseGraphOptions {
  int iterations = 20;
  const std::atomic<bool>* stop = nullptr;
};
/// For check_options().
void describe(kys::OptionList& list, PoseGraphOptions& options);

/// Minimises the squared residuals of the edges over the poses T_w_c, over SE(3) (essential graph,
/// ORB-SLAM Sec. III-D). Residual of an edge: [log of the rotation error (rad); translation error
/// (m)] of T_a_b^-1 * T_w_a^-1 * T_w_b, times its weight. At least one pose must be fixed.
void optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                         const std::vector<PoseGraphEdge>& edges,
                         const PoseGraphOptions& options = {});

}  // namespace kys_slam
