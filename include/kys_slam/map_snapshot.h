// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// A copy of the map at one moment. Poses and positions are expressed in the world frame of their
/// sub-map.
struct MapSnapshot {
  struct KeyFrame {
    std::uint32_t id = 0;
    std::uint32_t submap = 0;  ///< id of the first keyframe of its sub-map
    double timestamp = 0;      ///< s
    Rigid3 T_w_c;
  };
  struct Landmark {
    std::uint32_t id = 0;
    std::uint32_t submap = 0;
    std::uint16_t label = 0xFFFF;  ///< dense index in the label space; 0xFFFF: none
    std::int32_t instance = -1;    ///< -1: none
    float belief = 1;              ///< probability of being static; 1 unless the mode is `verified`
    std::uint32_t observations = 0;
    std::uint32_t reference = 0;  ///< id of the keyframe from which its range of distances is
    Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  ///< m
  };
  /// Two keyframes that share landmarks, are parent and child in the spanning tree, or are joined
  /// by a loop.
  struct Edge {
    std::uint32_t keyframe = 0;  ///< id, the later one
    std::uint32_t other = 0;     ///< id, the earlier one
    int shared_landmarks = 0;
    bool spanning_tree = false;
    bool loop = false;
  };

  std::int64_t frames = 0;          ///< number of frames fed
  std::uint32_t main_submap = 0;    ///< the one the trajectory is expressed in
  std::vector<KeyFrame> keyframes;  ///< by id
  std::vector<Landmark> landmarks;  ///< by id
  std::vector<Edge> edges;          ///< by keyframe, other
};

}  // namespace kys_slam
