// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <functional>
#include <limits>
#include <vector>

#include "simulator/common/coco_classes.h"
#include "simulator/shapes/materials.h"
#include "simulator/shapes/mesh.h"

namespace kys_slam::simulator {

/// Pose of a moving part at a time (s): T_w_o.
using Motion = std::function<Rigid3(double)>;

/// One copy of a mesh in the world.
struct Instance {
  int prototype = 0;
  int object = 0;
  Rigid3 T_w_o;  ///< used when `motion` is empty
  double scale = 1;
  float tint = 1;
  Motion motion;
};

/// An object: a thing, or all stuff of one class.
struct SceneObject {
  int category = kUnlabelled;
  bool can_move = false;
};

/// Light of a world.
struct Light {
  Eigen::Vector3d to_sun = Eigen::Vector3d(0.4, -0.5, 0.75).normalized();
  float sun = 1.35F;
  float ambient = 0.72F;
  float sky = 0.95F;  ///< brightness of the sky texture
  double shadow_ceiling =
      std::numeric_limits<double>::infinity();  ///< m; objects above cast no shadow
};

/// All visible objects. World frame: z up, m.
struct Scene {
  MaterialLibrary materials;
  std::vector<Mesh> prototypes;
  std::vector<Instance> instances;
  std::vector<SceneObject> objects;
  Light light;

  int add_prototype(Mesh mesh);
  int add_object(int category, bool can_move = false);
  /// Adds a static copy.
  void place(int prototype, int object, const Rigid3& T_w_o, double scale = 1, float tint = 1);
  void place_moving(int prototype, int object, Motion motion, double scale = 1, float tint = 1);
};

/// Pose on the ground: position and heading (rad, anticlockwise from +x).
Rigid3 ground_pose(double x, double y, double z, double heading);

}  // namespace kys_slam::simulator
