// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "simulator/common/rng.h"
#include "simulator/shapes/mesh.h"

namespace kys_slam::simulator {

enum class GroundFloor { kDwelling, kShops, kBlind };
enum class Roof { kFlat, kGable };

/// Appearance of a house. Houses of one style share window, bay and wall: their fronts repeat.
struct HouseStyle {
  int wall = 0;       ///< Material
  int base_wall = 0;  ///< Material of the ground floor
  int window = 0;     ///< Material
  int floors = 3;     ///< above the ground floor
  double floor_height = 3.1;
  double bay = 2.6;
  double window_width = 1.3;
  double window_height = 1.7;
  GroundFloor ground = GroundFloor::kDwelling;
  Roof roof = Roof::kFlat;
  bool balconies = false;
  bool bands = false;  ///< a cornice at each floor
};

/// One of the styles of a town; `index` counts from 0.
HouseStyle house_style(int index);
inline constexpr int kHouseStyles = 8;

/// A house on the rectangle [0, width] x [0, depth]; its front is the side y = 0, seen from -y.
/// Windows are set back into the walls.
Mesh make_house(const HouseStyle& style, double width, double depth, Rng& rng);

}  // namespace kys_slam::simulator
