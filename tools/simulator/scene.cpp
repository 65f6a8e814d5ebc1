#include "scene.h"

#include <utility>

namespace kys_slam::simulator {

const char* coco_name(int category) {
  switch (category) {
    case kPerson:
      return "person";
    case kCar:
      return "car";
    case kBus:
      return "bus";
    case kTruck:
      return "truck";
    case kTrafficLight:
      return "traffic light";
    case kBench:
      return "bench";
    case kChair:
      return "chair";
    case kPottedPlant:
      return "potted plant";
    case kRoad:
      return "road";
    case kShelf:
      return "shelf";
    case kTree:
      return "tree-merged";
    case kFenceClass:
      return "fence-merged";
    case kCeilingClass:
      return "ceiling-merged";
    case kSky:
      return "sky-other-merged";
    case kTableClass:
      return "table-merged";
    case kFloorOther:
      return "floor-other-merged";
    case kPavementClass:
      return "pavement-merged";
    case kGrassClass:
      return "grass-merged";
    case kBuilding:
      return "building-other-merged";
    case kWallOther:
      return "wall-other-merged";
    default:
      return "";
  }
}

bool coco_is_thing(int category) {
  return category > 0 && category <= 90;
}

const std::vector<int>& coco_categories() {
  static const std::vector<int> all = {
      kPerson,      kCar,        kBus,           kTruck,      kTrafficLight, kBench,        kChair,
      kPottedPlant, kRoad,       kShelf,         kTree,       kFenceClass,   kCeilingClass, kSky,
      kTableClass,  kFloorOther, kPavementClass, kGrassClass, kBuilding,     kWallOther};
  return all;
}

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
