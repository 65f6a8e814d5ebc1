// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "simulator/common/rng.h"
#include "simulator/shapes/props.h"
#include "simulator/worlds/path.h"
#include "simulator/worlds/scene.h"

namespace kys_slam::simulator {

/// An infinite straight road.
struct Road {
  Vec2 point;
  Vec2 direction;  ///< unit length
};
inline constexpr double kRoadHalfWidth = 5.5;  // m: a lane and a row of parked cars
inline constexpr double kLaneOffset = 1.7;     // m from the middle to the lane's middle
inline constexpr double kKerbHeight = 0.13;    // m

/// Layout of a town: two families of parallel roads, each sorted from the left to the right of its
/// direction.
struct TownPlan {
  std::vector<Road> first, second;
  std::vector<Vec2> near;  ///< only objects within `reach` of these points are built
  double reach = 110;      ///< m
  double parked = 0.75;    ///< share of the kerb with parked cars; 0: none anywhere
  std::vector<std::pair<Vec2, double>> keep_clear;  ///< no parked cars here: centre, radius (m)
};

/// Stuff of every town, one object per class.
struct TownObjects {
  int road, pavement, building, tree, post, fence;
};

/// Fills the scene: ground, pavements, houses, trees, furniture, parked cars, markings.
TownObjects build_town(Scene& scene, const TownPlan& plan, std::uint64_t seed);

/// Prototypes of moving objects.
struct MoverMeshes {
  std::vector<int> cars;  ///< by CarModel
  int truck, bus;
  struct Person {
    int body, leg, arm;
  };
  std::vector<Person> people;
};
MoverMeshes add_mover_meshes(Scene& scene);

/// A vehicle on a path, `offset` m to the left of it, at arc length s(t).
int add_vehicle(Scene& scene, int prototype, int category, const Path* path, double offset,
                std::function<double(double)> s, float tint);
/// A person who walks along a line from `start` at `speed` m/s (0: stands), limbs swinging.
int add_person(Scene& scene, const MoverMeshes::Person& meshes, const Vec2& start, double heading,
               double speed, double ground, double phase);

}  // namespace kys_slam::simulator
