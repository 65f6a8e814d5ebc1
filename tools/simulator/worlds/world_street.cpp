// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <memory>
#include <numbers>

#include "simulator/common/coco_classes.h"
#include "simulator/worlds/city.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {
namespace {

constexpr double kRate = 10.0;          // Hz
constexpr double kCameraHeight = 1.65;  // m
constexpr double kTurn = 70.0;          // degrees to the right
constexpr double kCrossingA = 88.0;     // m along the first street to the second
constexpr double kCrossingC = 50.0;     // m of the side street to the right of the first street

Vec2 right_of(const Vec2& d) {
  return {d.y(), -d.x()};
}

// The streets: A northwards, B which crosses it, C parallel to A.
struct Streets {
  Vec2 dir_a{0, 1};
  Vec2 dir_b{std::cos((90 - kTurn) * std::numbers::pi / 180),
             std::sin((90 - kTurn) * std::numbers::pi / 180)};
  Vec2 cross_a{0, kCrossingA};
  Vec2 cross_c = cross_a + dir_b * (kCrossingC / dir_b.x());
};

// Where the lanes of two streets meet; both keep to the right.
Vec2 lane_corner(const Streets& k) {
  const Vec2 a = k.cross_a + right_of(k.dir_a) * kLaneOffset;
  const Vec2 b = k.cross_a + right_of(k.dir_b) * kLaneOffset;
  // a + s*dir_a = b + t*dir_b, with dir_a = (0, 1).
  const double t = (a.x() - b.x()) / k.dir_b.x();
  return b + t * k.dir_b;
}

class StreetTraffic {
 public:
  StreetTraffic(World& world, const Streets& streets, const Drive& drive)
      : world_(world),
        k_(streets),
        drive_(std::make_shared<const Drive>(drive)),
        rng_(hash_of(world.seed, 202)),
        meshes_(add_mover_meshes(world.scene)) {}

  void add_all() {
    truck_ahead();
    oncoming_on_a();
    oncoming_on_b();
    crossing();
    waiting_van();
    people();
  }

 private:
  Path lane(const Vec2& point, const Vec2& direction, double from) const {
    const Vec2 p = point + right_of(direction) * kLaneOffset;
    return Path({p + direction * from, p + direction * (from + 400)}, 10);
  }
  int vehicle(int mesh, int category, const Path& path, std::function<double(double)> s,
              float tint) {
    return add_vehicle(world_.scene, mesh, category, &path, 0, std::move(s), tint);
  }

  // Same direction, close ahead, until the camera turns off; then it drives on.
  void truck_ahead() {
    const Path path = lane({0, 0}, k_.dir_a, -20);
    vehicle(
        meshes_.truck, kTruck, path,
        [drive = drive_](double t) {
          const double follow = 20 + 4.1 + 7.3 + 0.7 * std::sin(0.55 * t);
          const double leave = 8.2;  // s: from here on its own speed
          if (t < leave) return drive->distance(t) + follow;
          const double at = drive->distance(leave) + 20 + 4.1 + 7.3 + 0.7 * std::sin(0.55 * leave);
          return at + 8.2 * (t - leave) +
                 0.25 * std::min(t - leave, 4.0) * std::min(t - leave, 4.0);
        },
        1);
  }

  struct Kind {
    int mesh;
    int category;
  };
  Kind pick(int i) {
    switch (i % 6) {
      case 2:
        return {meshes_.bus, kBus};
      case 4:
        return {meshes_.truck, kTruck};
      case 1:
        return {meshes_.cars[2], kCar};
      default:
        return {meshes_.cars[rng_.below(4)], kCar};
    }
  }

  void oncoming_on_a() {
    const Path path = lane({0, 0}, -k_.dir_a, -250);
    double gap = 0;
    for (int i = 0; i < 13; ++i) {
      const Kind kind = pick(i);
      // In front of the camera at the start, one behind the other.
      const double start = 250 - 16 - gap;
      gap += (kind.category == kCar ? 11.5 : 17.0) + rng_.uniform(0, 3);
      vehicle(
          kind.mesh, kind.category, path, [start](double t) { return start + 7.6 * t; }, tint());
    }
  }

  void oncoming_on_b() {
    // Measured from the crossing with A, against the driving direction.
    const Path path = lane(k_.cross_a, -k_.dir_b, -200);
    for (int i = 0; i < 5; ++i) {
      const Kind kind = pick(i + 1);
      const double at_turn_end = 26.0 + 14.5 * i;  // m from the crossing at t = 12.5 s
      const double start = 200 - at_turn_end - 7.0 * 12.5;
      vehicle(
          kind.mesh, kind.category, path, [start](double t) { return start + 7.0 * t; }, tint());
    }
    // A queue beyond the side street that waits for the crossing bus.
    for (int i = 0; i < 4; ++i) {
      const double stop = 200 - (kCrossingC / k_.dir_b.x() + 13.0 + 7.0 * i);
      const double go = 20.0 + 0.8 * i;
      vehicle(
          i == 1 ? meshes_.truck : meshes_.cars[i % 4], i == 1 ? kTruck : kCar, path,
          [stop = i >= 2 ? stop - 3.0 : stop, go](double t) {
            const double r = std::max(0.0, t - go);
            return stop + (r < 4 ? 0.9 * r * r : 14.4 + 7.2 * (r - 4));
          },
          tint());
    }
  }

  // From the left to the right through the side street, just in front of the camera.
  void crossing() {
    const Path path = lane(k_.cross_c, -k_.dir_a, -200);
    struct One {
      int mesh, category;
      double time;
    };
    const One all[] = {{meshes_.bus, kBus, 18.6}, {meshes_.cars[0], kCar, 20.6}};
    for (const One& one : all) {
      const double time = one.time;
      vehicle(
          one.mesh, one.category, path, [time](double t) { return 200 + 1.5 + 7.5 * (t - time); },
          tint());
    }
  }

  // Stands at the kerb of the second street, pulls out in front of the camera and drives on.
  void waiting_van() {
    const Path path = lane(k_.cross_a, k_.dir_b, 0);
    const double at = 27.0;
    const double go = 11.3;
    const int object = world_.scene.add_object(kCar, true);
    auto shared = std::make_shared<const Path>(path);
    const auto distance = [=](double t) {
      const double r = std::max(0.0, t - go);
      return at + (r < 4.4 ? 0.85 * r * r : 0.85 * 4.4 * 4.4 + 7.48 * (r - 4.4));
    };
    world_.scene.place_moving(
        meshes_.cars[2], object,
        [=](double t) {
          const double s = distance(t);
          const auto offset = [&](double x) { return -2.65 * (1 - smooth_step(at, at + 11, x)); };
          const Vec2 p = shared->position(s, offset(s));
          const double slope = (offset(s + 0.05) - offset(s - 0.05)) / 0.1;
          return ground_pose(p.x(), p.y(), 0, shared->heading(s) + std::atan(slope));
        },
        1, 0.8F);
  }

  void people() {
    const auto walkers = [&](const Vec2& origin, const Vec2& d, double from, double to, int count) {
      for (int i = 0; i < count; ++i) {
        const double side = i % 2 == 0 ? 1.0 : -1.0;
        const bool forward = rng_.chance(0.5);
        const Vec2 walk = forward ? d : Vec2(-d);
        const double s = from + (to - from) * (i + rng_.uniform(0.1, 0.9)) / count;
        const double speed = rng_.uniform(1.0, 1.6);
        // They are near the camera when it comes by: set back by what they walk till then.
        const double met = s / 8.0 + (d.x() > 0.1 ? 12.5 : 0.0);
        const Vec2 start = origin + d * s - walk * (speed * met * 0.8) +
                           right_of(d) * side * (kRoadHalfWidth + rng_.uniform(1.7, 2.5));
        const double phase = rng_.uniform(0, 2 * std::numbers::pi);
        add_person(world_.scene, meshes_.people[rng_.below(6)], start,
                   std::atan2(walk.y(), walk.x()), speed, kKerbHeight, phase);
      }
    };
    walkers({0, 0}, k_.dir_a, 6, 78, 22);
    walkers(k_.cross_a, k_.dir_b, 14, 46, 10);
    // Two stand and talk at the corner.
    const Vec2 corner = k_.cross_a + Vec2(9.5, -8.5);
    add_person(world_.scene, meshes_.people[1], corner, 0.3, 0, kKerbHeight, 0);
    add_person(world_.scene, meshes_.people[4], corner + Vec2(0.8, 0.2), 3.4, 0, kKerbHeight, 0);
  }

  float tint() {
    constexpr float tints[] = {0.12F, 0.8F, 0.5F, 0.3F, 0.65F};
    return tints[rng_.below(5)];
  }

  World& world_;
  const Streets& k_;
  std::shared_ptr<const Drive> drive_;
  Rng rng_;
  MoverMeshes meshes_;
};

}  // namespace

World make_street(const WorldOptions& options) {
  World world;
  world.name = "street";
  world.seed = options.seed;
  const int frames = options.frames > 0 ? options.frames : 200;
  const double duration = frames / kRate + 1;
  set_kitti_rig(world, options);
  world.scene.materials = make_materials(hash_of(options.seed, 1));
  world.scene.light.to_sun = Vec3(-0.5, -0.28, 0.75).normalized();

  const Streets streets;
  const Vec2 corner = lane_corner(streets);
  const Path ego({{kLaneOffset, 0}, corner, corner + streets.dir_b * 300}, 11.0);
  const double turn = corner.y() - 12;  // roughly where the turn begins
  const double side = turn + 22 + 32;   // where the side street is close
  const Drive drive(0, duration, [&](double s, double) {
    return 8.6 - 3.4 * (smooth_step(turn - 16, turn - 1, s) - smooth_step(side, side + 18, s));
  });

  TownPlan plan;
  plan.first = {{{0, 0}, streets.dir_a}, {streets.cross_c, streets.dir_a}};
  plan.second = {{streets.cross_a, streets.dir_b}};
  for (double s = 0; s < drive.distance(duration) + 40; s += 10)
    plan.near.push_back(ego.position(s));
  const Vec2 van = streets.cross_a + right_of(streets.dir_b) * 4.35 + streets.dir_b * 27.0;
  plan.keep_clear = {{van, 7.5}, {van + streets.dir_b * 7, 4.0}};
  build_town(world.scene, plan, options.seed);
  StreetTraffic(world, streets, drive).add_all();

  for (int i = 0; i < frames; ++i) {
    const double t = i / kRate;
    world.times.push_back(t);
    world.T_w_c.push_back(car_camera(ego, drive.distance(t), t, kCameraHeight));
  }
  return world;
}

}  // namespace kys_slam::simulator
