// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/shapes/texture.h"

namespace kys_slam::simulator {

/// All surface materials.
enum Material : std::uint16_t {
  kAsphalt,
  kRoadPaint,
  kPavement,
  kKerb,
  kGrass,
  kBrickRed,
  kBrickPale,
  kPlasterLight,
  kPlasterDark,
  kStone,
  kConcrete,
  kRoofTile,
  kRoofFlat,
  kTrim,
  kWindow0,
  kWindow1,
  kWindow2,
  kWindow3,
  kWindow4,
  kWindow5,
  kDoor0,
  kDoor1,
  kShop0,
  kShop1,
  kShop2,
  kShop3,
  kSign0,
  kSign1,
  kSign2,
  kSign3,
  kSign4,
  kSign5,
  kCarSide,
  kCarPaint,
  kCarGlass,
  kCarFront,
  kCarRear,
  kRubber,
  kRim,
  kBlack,
  kTruckSide,
  kTruckRear,
  kTruckFront,
  kBusSide,
  kBusRear,
  kBusFront,
  kCloth0,
  kCloth1,
  kCloth2,
  kCloth3,
  kSkin,
  kHair,
  kBark,
  kLeaves,
  kMetal,
  kFence,
  kWood,
  kTrafficSign,
  kFloorTiles,
  kWallPanel,
  kCeiling,
  kCrate,
  kCardboard,
  kMachine,
  kRackLoad0,
  kRackLoad1,
  kPoster0,
  kPoster1,
  kPoster2,
  kPoster3,
  kClouds,
  kMaterialCount
};

/// Appearance of a material: a tiling texture, and a large one that makes its repeats distinct.
struct MaterialAppearance {
  Texture texture;
  float scale_u = 1;  ///< tiles per unit of the mesh's texture coordinates
  float scale_v = 1;
  bool grimy = false;   ///< multiplied by the large dirt texture
  bool tinted = false;  ///< multiplied by the tint of the instance
};

struct MaterialLibrary {
  std::vector<MaterialAppearance> appearances;  ///< indexed by Material
  Texture grime;                                ///< mean 0.5; factor is 0.5 + value
  float grime_scale = 1.0F / 23.0F;             ///< tiles per metre
};

/// Generates all textures. The same seed gives the same textures.
MaterialLibrary make_materials(std::uint64_t seed);

}  // namespace kys_slam::simulator
