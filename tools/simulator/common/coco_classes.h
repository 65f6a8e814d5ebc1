// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace kys_slam::simulator {

/// COCO panoptic category ids used in the worlds. `kUnlabelled` becomes void (id 0).
enum CocoClass : int {
  kUnlabelled = 0,
  kPerson = 1,
  kCar = 3,
  kBus = 6,
  kTruck = 8,
  kTrafficLight = 10,
  kBench = 15,
  kChair = 62,
  kPottedPlant = 64,
  kRoad = 149,
  kShelf = 156,
  kTree = 184,
  kFenceClass = 185,
  kCeilingClass = 186,
  kSky = 187,
  kTableClass = 189,
  kFloorOther = 190,
  kPavementClass = 191,
  kGrassClass = 193,
  kBuilding = 197,
  kWallOther = 199,
};
/// Name of a category id used here, as in the COCO list; "" for kUnlabelled.
const char* coco_name(int category);
bool coco_is_thing(int category);
/// All category ids in use (without kUnlabelled), ascending.
const std::vector<int>& coco_categories();

/// Dense index in COCO's panoptic label space of a category id; kys::kVoidLabel for kUnlabelled.
std::uint16_t coco_label(int category);
inline constexpr const char* kFeatureLabelSpace = "coco_panoptic_133";

}  // namespace kys_slam::simulator
