#pragma once

#include <kys_slam/rigid3.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// The map at one moment, by value: nothing in it changes afterwards. Positions are in the frame of
/// the sub-map they belong to.
struct MapSnapshot {
  struct KeyFrame {
    std::uint32_t id = 0;
    std::uint32_t submap = 0;  ///< id of the keyframe that began its sub-map
    double timestamp = 0;      ///< s
    Rigid3 T_w_c;
  };
  struct Landmark {
    std::uint32_t id = 0;
    std::uint32_t submap = 0;
    std::uint16_t label = 0xFFFF;  ///< dense index in the label space; 0xFFFF: none
    std::int32_t instance = -1;    ///< -1: none
    float belief = 1;  ///< probability of standing still; 1 unless the mode is `verified`
    std::uint32_t observations = 0;
    Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  ///< m
  };
  /// Two keyframes that see the same landmarks, follow each other in the spanning tree, or were
  /// tied by a loop.
  struct Edge {
    std::uint32_t keyframe = 0;  ///< id, the later one
    std::uint32_t other = 0;     ///< id, the earlier one
    int shared_landmarks = 0;
    bool spanning_tree = false;
    bool loop = false;
  };

  std::int64_t frames = 0;          ///< fed so far
  std::uint32_t main_submap = 0;    ///< the one the trajectory is expressed in
  std::vector<KeyFrame> keyframes;  ///< by id
  std::vector<Landmark> landmarks;  ///< by id
  std::vector<Edge> edges;          ///< by keyframe, other
};

}  // namespace kys_slam
