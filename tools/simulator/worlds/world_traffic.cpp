// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "simulator/common/coco_classes.h"
#include "simulator/worlds/city.h"
#include "simulator/worlds/world.h"

// Two worlds on one straight street of four lanes without parking rows: `traffic`, where nearly
// everything near drives, and `jam`, where nearly everything near stands and may start any time.
namespace kys_slam::simulator {
namespace {

constexpr double kRate = 10.0;          // Hz
constexpr double kCameraHeight = 1.65;  // m
constexpr double kInner = 1.45;         // m from the middle of the street to the inner lanes
constexpr double kOuter = 4.22;         // m, to the outer lanes
constexpr double kStart = -110.0;       // m, where the camera starts along the street
constexpr double kLaneEnd = 300.0;      // m, on both sides of the middle

/// A vehicle that waits for its place in a lane.
struct Kind {
  int mesh;
  int category;
  double length;  ///< m
};

/// A lane: vehicles are placed by how far along their own direction their middle is.
class Lane {
 public:
  /// \param x  m, across the street; \param forward  in the camera's direction
  Lane(double x, bool forward)
      : path_({{x, forward ? -kLaneEnd : kLaneEnd}, {x, forward ? kLaneEnd : -kLaneEnd}}, 10),
        forward_(forward) {}
  /// Arc length of a place along the street.
  [[nodiscard]] double at(double y) const { return forward_ ? y + kLaneEnd : kLaneEnd - y; }
  [[nodiscard]] const Path& path() const { return path_; }

 private:
  Path path_;
  bool forward_;
};

class Vehicles {
 public:
  Vehicles(World& world, std::uint64_t stream)
      : world_(world), rng_(hash_of(world.seed, stream)), meshes_(add_mover_meshes(world.scene)) {}

  /// \param tall  share of buses, trucks and vans
  Kind pick(double tall) {
    if (!rng_.chance(tall)) {
      constexpr int cars[] = {0, 1, 3};
      return {meshes_.cars[static_cast<std::size_t>(cars[rng_.below(3)])], kCar, 4.6};
    }
    switch (rng_.below(4)) {
      case 0:
        return {meshes_.bus, kBus, 11.0};
      case 1:
      case 2:
        return {meshes_.truck, kTruck, 8.2};
      default:
        return {meshes_.cars[2], kCar, 5.0};
    }
  }
  void add(const Kind& kind, const Lane& lane, std::function<double(double)> s) {
    constexpr float tints[] = {0.12F, 0.8F, 0.5F, 0.3F, 0.65F};
    add_vehicle(world_.scene, kind.mesh, kind.category, &lane.path(), 0, std::move(s),
                tints[rng_.below(5)]);
  }
  void walkers(double from, double to, int count) {
    for (int i = 0; i < count; ++i) {
      const double side = i % 2 == 0 ? 1.0 : -1.0;
      const double heading = (rng_.chance(0.5) ? 1 : -1) * std::numbers::pi / 2;
      const double along = from + (to - from) * (i + rng_.uniform()) / count;
      const Vec2 start(side * (kRoadHalfWidth + rng_.uniform(1.0, 2.5)), along);
      const double phase = rng_.uniform(0, 6);
      const double speed = rng_.uniform(1.0, 1.6);
      add_person(world_.scene, meshes_.people[static_cast<std::size_t>(rng_.below(6))], start,
                 heading, speed, kKerbHeight, phase);
    }
  }
  Rng& rng() { return rng_; }

 private:
  World& world_;
  Rng rng_;
  MoverMeshes meshes_;
};

World straight_street(const WorldOptions& options, const std::string& name, const Drive& drive,
                      int frames) {
  World world;
  world.name = name;
  world.seed = options.seed;
  set_kitti_rig(world, options);
  world.scene.materials = make_materials(hash_of(options.seed, 1));
  world.scene.light.to_sun = Vec3(-0.5, -0.28, 0.75).normalized();
  const Path ego({{kInner, kStart}, {kInner, kLaneEnd}}, 10);
  TownPlan plan;
  plan.first = {{{0, 0}, {0, 1}}};
  plan.second = {{{0, 40}, {1, 0}}};
  for (double s = 0; s < drive.distance(frames / kRate) + 60; s += 10) {
    plan.near.push_back(ego.position(s));
  }
  plan.parked = 0;
  build_town(world.scene, plan, hash_of(options.seed, 505));
  for (int i = 0; i < frames; ++i) {
    const double t = i / kRate;
    world.times.push_back(t);
    world.T_w_c.push_back(car_camera(ego, drive.distance(t), t, kCameraHeight));
  }
  return world;
}

}  // namespace

// The camera drives in the inner lane at 5.5-8.5 m/s. The vehicles ahead keep their distance, those
// of the outer lane fall back and catch up, both lanes of oncoming traffic are dense.
World make_traffic(const WorldOptions& options) {
  const int frames = options.frames > 0 ? options.frames : 200;
  const double duration = frames / kRate + 1;
  const auto drive = std::make_shared<const Drive>(
      0, duration, [](double, double t) { return 7.0 + 1.5 * std::sin(0.45 * t); });
  World world = straight_street(options, "traffic", *drive, frames);
  Vehicles vehicles(world, 606);
  Rng& rng = vehicles.rng();

  const Lane ahead(kInner, true);
  for (double gap = rng.uniform(8.5, 10.5); gap < 70;) {
    const Kind kind = vehicles.pick(0.65);
    const double s = ahead.at(kStart) + gap + kind.length / 2;
    const double phase = rng.uniform(0, 2 * std::numbers::pi);
    vehicles.add(kind, ahead, [=](double t) {
      return s + drive->distance(t) + 0.6 * std::sin(0.5 * t + phase);
    });
    gap += kind.length + rng.uniform(5, 8);
  }
  const Lane beside(kOuter, true);
  const double sway = rng.uniform(0, 2 * std::numbers::pi);
  for (double place = -24 + rng.uniform(0, 6); place < 80;) {
    const Kind kind = vehicles.pick(0.55);
    const double s = beside.at(kStart) + place + kind.length / 2;
    const double phase = rng.uniform(0, 2 * std::numbers::pi);
    vehicles.add(kind, beside, [=](double t) {
      return s + drive->distance(t) + 5.0 * std::sin(0.3 * t + sway) +
             0.5 * std::sin(0.7 * t + phase);
    });
    place += kind.length + rng.uniform(2.5, 5);
  }
  for (const double x : {-kInner, -kOuter}) {
    const Lane oncoming(x, false);
    const double speed = x == -kInner ? 6.8 : 5.6;
    for (double y = kStart + rng.uniform(2, 8); y < kLaneEnd - 10;) {
      const Kind kind = vehicles.pick(0.55);
      const double s = oncoming.at(y + kind.length / 2);
      vehicles.add(kind, oncoming, [=](double t) { return s + speed * t; });
      y += kind.length + rng.uniform(3, 6);
    }
  }
  vehicles.walkers(kStart, kStart + 160, 16);
  return world;
}

// The camera creeps along the inner lane, stops and goes on. All other lanes are full of vehicles
// that stand; groups of them close up to the group before them, one after the other.
World make_jam(const WorldOptions& options) {
  const int frames = options.frames > 0 ? options.frames : 200;
  const double duration = frames / kRate + 2;
  const auto pace = [](double t) {  // m/s
    return 2.6 * (1 - smooth_step(3.5, 4.5, t) + smooth_step(5.5, 6.5, t)) +
           0.9 * std::sin(0.9 * t) * smooth_step(6.5, 7.5, t);
  };
  const auto drive =
      std::make_shared<const Drive>(0, duration, [&](double, double t) { return pace(t); });
  World world = straight_street(options, "jam", *drive, frames);
  Vehicles vehicles(world, 707);
  Rng& rng = vehicles.rng();

  // Ahead: brakes and starts 0.8 s before the camera does.
  const Lane ahead(kInner, true);
  for (double gap = rng.uniform(9, 11); gap < 60;) {
    const Kind kind = vehicles.pick(0.5);
    const double s = ahead.at(kStart) + gap + kind.length / 2;
    vehicles.add(kind, ahead, [=](double t) { return s + drive->distance(t + 0.8); });
    gap += kind.length + rng.uniform(3, 6);
  }
  for (const double x : {kOuter, -kInner, -kOuter}) {
    const Lane lane(x, x > 0);
    // From the head of the lane to its tail, so that followers start after those before them.
    double room = 0;    // m, that the group may drive up
    double start = -1;  // s, when its first vehicle starts
    int left = 0;       // vehicles of the group still to come
    for (double place = lane.at(x > 0 ? kStart + 120 : kStart - 30);
         place > lane.at(x > 0 ? kStart - 30 : kStart + 120);) {
      if (left == 0) {
        left = 2 + rng.below(4);
        room = rng.chance(0.45) ? rng.uniform(4, 9) : 0.0;
        start = rng.uniform(0.5, 14);
        place -= room;
      }
      const Kind kind = vehicles.pick(0.95);
      const double s = place - kind.length / 2;
      const double time = room / 2.2;  // s: 3.3 m/s at most
      vehicles.add(kind, lane, [=](double t) {
        return s + (room > 0 ? room * smooth_step(start, start + time, t) : 0.0);
      });
      start += rng.uniform(0.8, 1.4);
      place -= kind.length + rng.uniform(0.9, 2.2);
      --left;
    }
  }
  vehicles.walkers(kStart, kStart + 70, 10);
  return world;
}

}  // namespace kys_slam::simulator
