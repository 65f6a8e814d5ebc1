// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "simulator/shapes/mesh.h"

namespace kys_slam::simulator {

/// Meshes of objects on the ground. Frame of a vehicle or person: x forward, y left, z up, origin
/// on the ground below the middle. Metres.

enum class CarModel { kHatchback, kSaloon, kVan, kEstate };
Mesh make_car(CarModel model);
Mesh make_truck();  ///< box truck, 8 x 2.5 x 3.5 m
Mesh make_bus();    ///< 11 x 2.55 x 3.1 m

/// A person has a body and four limbs that swing about the hip or shoulder (the origin of their
/// frame).
struct PersonMeshes {
  Mesh body, leg, arm;
};
PersonMeshes make_person(int clothes);
inline constexpr double kHipHeight = 0.90;       // m
inline constexpr double kShoulderHeight = 1.42;  // m

Mesh make_tree(std::uint64_t seed, double height);
Mesh make_street_lamp();    ///< arm points along +x
Mesh make_traffic_light();  ///< faces +x
Mesh make_sign_post();      ///< faces +x
Mesh make_bench();
Mesh make_bin();
Mesh make_planter(std::uint64_t seed);
Mesh make_bollard();
Mesh make_poster_stand(int poster);
Mesh make_hedge(double length, std::uint64_t seed);

}  // namespace kys_slam::simulator
