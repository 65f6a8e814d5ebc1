// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/coco_classes.h"

#include <kys/distance.h>
#include <kys/label_space.h>

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

std::uint16_t coco_label(int category) {
  static const kys::LabelSpace space = kys::load_label_space(kFeatureLabelSpace);
  return category == kUnlabelled ? kys::kVoidLabel : space.index_of(category);
}

}  // namespace kys_slam::simulator
