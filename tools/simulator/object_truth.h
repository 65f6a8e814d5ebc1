#pragma once

#include <kys_slam/rigid3.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "segments.h"
#include "world.h"

namespace kys_slam::simulator {

/// Where the objects that can move are: exact poses, boxes and velocities. An object's frame is
/// that of its first part: x forward, y left, z up, origin on the ground below its middle. Poses
/// are expressed in the frame of the sequence's ground truth: the first left camera (kKitti) or the
/// world (kEuroc).
class ObjectTruth {
 public:
  explicit ObjectTruth(const World& world);

  struct Row {
    int object = 0;  ///< index into Scene::objects
    Rigid3 T_g_o;
    Eigen::Vector3d velocity;  ///< of the origin, m/s, in the frame of the ground truth
    Eigen::AlignedBox3d box;   ///< in the object's frame, as it is in the first frame
  };
  /// Objects that can move, in order of number.
  [[nodiscard]] std::vector<Row> rows(int frame) const;

  static const char* csv_header();
  /// Lines of the objects that either view of a frame shows.
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

/// What share of the left image objects that can move cover, those that move and those that stand.
struct CoveredShare {
  double moving = 0;
  double standing = 0;
};
CoveredShare covered_share(const World& world, const Panoptic& left);

}  // namespace kys_slam::simulator
