// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/scene.h"

#include <utility>

namespace kys_slam::simulator {

int Scene::add_prototype(Mesh mesh) {
  prototypes.push_back(std::move(mesh));
  return static_cast<int>(prototypes.size()) - 1;
}

int Scene::add_object(int category, bool can_move) {
  objects.push_back({category, can_move});
  return static_cast<int>(objects.size()) - 1;
}

void Scene::place(int prototype, int object, const Rigid3& T_w_o, double scale, float tint) {
  instances.push_back({prototype, object, T_w_o, scale, tint, {}});
}

void Scene::place_moving(int prototype, int object, Motion motion, double scale, float tint) {
  instances.push_back({prototype, object, Rigid3(), scale, tint, std::move(motion)});
}

Rigid3 ground_pose(double x, double y, double z, double heading) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ())),
          Eigen::Vector3d(x, y, z)};
}

}  // namespace kys_slam::simulator
