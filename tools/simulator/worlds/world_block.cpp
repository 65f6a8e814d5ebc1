// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <numbers>

#include "simulator/common/coco_classes.h"
#include "simulator/worlds/city.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {
namespace {

constexpr double kRate = 10.0;          // Hz
constexpr double kCameraHeight = 1.65;  // m
constexpr double kBlockWidth = 62.0;    // m between the middles of the streets
constexpr double kBlockHeight = 48.0;
constexpr double kOverlap = 34.0;  // m driven again after one round

// Clockwise in the right lane: north, east, south, west, and again.
Path round_the_block() {
  const double x0 = kLaneOffset;
  const double x1 = kBlockWidth - kLaneOffset;
  const double y0 = kLaneOffset;
  const double y1 = kBlockHeight - kLaneOffset;
  const Vec2 corners[] = {{x0, y1}, {x1, y1}, {x1, y0}, {x0, y0}};
  std::vector<Vec2> line = {{x0, kBlockHeight / 2 - 8}};
  for (int i = 0; i < 9; ++i) line.push_back(corners[i % 4]);
  return {line, 7.5};
}

// Arc length at which the path first comes back to where it began.
double round_length(const Path& path) {
  double best = 100;
  for (double s = 100; s < path.length(); s += 0.05) {
    if ((path.position(s) - path.position(0)).norm() <
        (path.position(best) - path.position(0)).norm()) {
      best = s;
    }
    if (s > best + 30 && (path.position(best) - path.position(0)).norm() < 0.1) break;
  }
  return best;
}

void add_life(World& world) {
  const MoverMeshes meshes = add_mover_meshes(world.scene);
  Rng rng(hash_of(world.seed, 303));
  const double y = kBlockHeight;
  const Path east({{-150, -kLaneOffset}, {200, -kLaneOffset}}, 10);
  const Path west({{200, y + kLaneOffset}, {-150, y + kLaneOffset}}, 10);
  add_vehicle(
      world.scene, meshes.cars[0], kCar, &east, 0, [](double t) { return 20 + 7.0 * t; }, 0.5F);
  add_vehicle(
      world.scene, meshes.cars[1], kCar, &west, 0, [](double t) { return 30 + 8.0 * t; }, 0.2F);
  for (int i = 0; i < 8; ++i) {
    const bool along_x = i % 2 == 0;
    const double d = kRoadHalfWidth + rng.uniform(1.8, 2.6);
    const Vec2 start = along_x ? Vec2(rng.uniform(0, 50), i % 4 == 0 ? kBlockHeight + d : -d)
                               : Vec2(i % 4 == 1 ? kBlockWidth + d : -d, rng.uniform(0, 40));
    const double heading =
        (along_x ? 0 : std::numbers::pi / 2) + (rng.chance(0.5) ? std::numbers::pi : 0);
    const double phase = rng.uniform(0, 6);
    const double speed = rng.uniform(0.9, 1.4);
    add_person(world.scene, meshes.people[static_cast<std::size_t>(rng.below(6))], start, heading,
               speed, kKerbHeight, phase);
  }
}

}  // namespace

World make_block(const WorldOptions& options) {
  World world;
  world.name = "block";
  world.seed = options.seed;
  set_kitti_rig(world, options);
  world.scene.materials = make_materials(hash_of(options.seed, 1));
  world.scene.light.to_sun = Vec3(-0.45, 0.38, 0.8).normalized();

  const Path path = round_the_block();
  const double total = round_length(path) + kOverlap;
  // A frame per step; slower where it turns.
  const Drive drive(0, 90, [&](double s, double) {
    return 8.8 - 3.0 * smooth_step(0.0, 0.09, std::abs(path.curvature(s + 2.5)));
  });
  int frames = options.frames;
  if (frames <= 0) {
    while (drive.distance(frames / kRate) < total) ++frames;
    ++frames;
  }

  TownPlan plan;
  plan.first = {{{0, 0}, {0, 1}}, {{kBlockWidth, 0}, {0, 1}}};
  plan.second = {{{0, kBlockHeight}, {1, 0}}, {{0, 0}, {1, 0}}};
  for (double s = 0; s < total; s += 10) plan.near.push_back(path.position(s));
  plan.reach = 95;
  plan.parked = 0.85;
  build_town(world.scene, plan, hash_of(options.seed, 404));
  add_life(world);

  for (int i = 0; i < frames; ++i) {
    const double t = i / kRate;
    world.times.push_back(t);
    world.T_w_c.push_back(car_camera(path, drive.distance(t), t, kCameraHeight));
  }
  return world;
}

}  // namespace kys_slam::simulator
