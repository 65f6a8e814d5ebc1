// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "simulator/images/segments.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {

/// Exact poses, boxes and velocities of objects that can move. An object's frame is that of its
/// first part: x forward, y left, z up, origin on the ground below its middle. Poses are expressed
/// in the frame of the sequence's ground truth: the first left camera (kKitti) or the world
/// (kEuroc).
class ObjectTruth {
 public:
  explicit ObjectTruth(const World& world);

  struct Row {
    int object = 0;  ///< index into Scene::objects
    Rigid3 T_g_o;
    Eigen::Vector3d velocity;  ///< of the origin, m/s, in the frame of the ground truth
    Eigen::AlignedBox3d box;   ///< m, in the object's frame, from the first frame
  };
  /// Objects that can move, in order of number.
  [[nodiscard]] std::vector<Row> rows(int frame) const;

  static const char* csv_header();
  /// CSV lines of the objects visible in either view of a frame.
  [[nodiscard]] std::string csv(int frame, const std::vector<bool>& moving, const Panoptic& left,
                                const Panoptic& right) const;

 private:
  struct Object {
    int object = 0;
    std::vector<int> parts;  ///< indices into Scene::instances, the first gives the frame
    Eigen::AlignedBox3d box;
  };
  const World& world_;
  Rigid3 T_g_w_;
  std::vector<Object> objects_;
};

/// Share of the left image covered by objects that can move: those that move, and static ones.
struct CoveredShare {
  double moving = 0;
  double standing = 0;
};
CoveredShare covered_share(const World& world, const Panoptic& left);

}  // namespace kys_slam::simulator
