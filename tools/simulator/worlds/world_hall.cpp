// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/stereo_rectifier.h>

#include <cmath>
#include <numbers>

#include "simulator/common/coco_classes.h"
#include "simulator/common/euroc_rig.h"
#include "simulator/worlds/city.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {
namespace {

constexpr double kRate = 20.0;                                  // Hz
constexpr double kLength = 25.0, kWidth = 15.0, kHeight = 7.0;  // m
constexpr double kPeriod = 24.0;                                // s, once around the eight

struct HallObjects {
  int floor, wall, ceiling, post, shelf;
};

// A vertical rectangle seen from the side `right` x up points away from.
void wall_with_things(Mesh& m, const Vec3& origin, const Vec3& right, double length, Rng& rng) {
  const Vec3 up(0, 0, 1);
  const Vec3 out = right.cross(up);
  const auto at = [&](double x, double z, double o) {
    return Vec3(origin + right * x + up * z + out * o);
  };
  m.quad_metric(at(0, 0, 0), at(length, 0, 0), at(length, kHeight, 0), at(0, kHeight, 0),
                kWallPanel, {rng.uniform(0, 4), 0});
  const auto panel = [&](double x0, double z0, double x1, double z1, int material, double o) {
    m.panel(at(x0, z0, o), at(x1, z0, o), at(x1, z1, o), at(x0, z1, o), material);
  };
  for (double x = 1.0; x < length - 2.4; x += 2.6) {  // a row of windows under the roof
    panel(x, 4.6, x + 1.9, 6.2, kWindow0 + rng.below(6), 0.03);
  }
  for (double x = 0.8; x < length - 2.5; x += rng.uniform(2.2, 3.6)) {
    const int kind = rng.below(4);
    if (kind == 0) panel(x, 0.02, x + 1.2, 2.3, kDoor0 + rng.below(2), 0.03);
    if (kind == 1) panel(x, 1.2, x + 1.3, 3.1, kPoster0 + rng.below(4), 0.02);
    if (kind == 2) panel(x, 2.5, x + 2.2, 3.2, kSign0 + rng.below(6), 0.02);
    if (kind == 3) panel(x, 0.9, x + 1.0, 2.2, kMachine, 0.04);
  }
  for (int k = 0; k < 3; ++k) {  // pipes
    const double z = 3.6 + 0.22 * k;
    m.tube(at(0, z, 0.15), at(length, z, 0.15), 0.05, 0.05, 8, kMetal, false);
  }
}

Mesh make_shell_floor() {
  Mesh m;
  const double x = kLength / 2;
  const double y = kWidth / 2;
  m.floor_polygon({{-x, -y}, {x, -y}, {x, y}, {-x, y}}, 0, kFloorTiles);
  for (double s = -x + 2; s < x - 2; s += 0.9) {  // a dashed walkway
    for (const double t : {-5.1, 5.0}) {
      m.quad_metric({s, t, 0.004}, {s + 0.6, t, 0.004}, {s + 0.6, t + 0.12, 0.004},
                    {s, t + 0.12, 0.004}, kRoadPaint);
    }
  }
  return m;
}

Mesh make_ceiling() {
  Mesh m;
  const double x = kLength / 2;
  const double y = kWidth / 2;
  m.quad_metric({-x, y, kHeight}, {x, y, kHeight}, {x, -y, kHeight}, {-x, -y, kHeight}, kCeiling);
  for (double s = -x + 1.5; s < x; s += 3.0) {
    m.box({s - 0.15, -y, kHeight - 0.55}, {s + 0.15, y, kHeight - 0.05}, kMetal);
  }
  for (double s = -x + 3; s < x - 1; s += 3.0) {
    for (const double t : {-4.0, 0.0, 4.0}) {
      m.box({s - 0.7, t - 0.1, kHeight - 0.5}, {s + 0.7, t + 0.1, kHeight - 0.4}, kRoadPaint);
    }
  }
  return m;
}

// Uprights, boards and what lies on them; along x, seen from both sides.
Mesh make_rack(Rng& rng) {
  Mesh m;
  for (const double x : {-1.5, 0.0, 1.45}) {
    for (const double y : {-0.45, 0.4}) m.box({x, y, 0}, {x + 0.06, y + 0.05, 3.0}, kMetal);
  }
  for (int level = 0; level < 4; ++level) {
    const double z = 0.15 + 0.75 * level;
    m.box({-1.5, -0.45, z}, {1.5, 0.45, z + 0.05}, kWood);
    double x = -1.4;
    while (x < 1.1) {
      const double w = rng.uniform(0.25, 0.6);
      const double h = rng.uniform(0.25, 0.58);
      const int what = rng.below(4);
      m.box({x, -0.38, z + 0.05}, {std::min(x + w, 1.42), rng.uniform(0.1, 0.38), z + 0.05 + h},
            what == 0   ? kCrate
            : what == 1 ? kCardboard
            : what == 2 ? kMachine
                        : kCardboard);
      x += w + rng.uniform(0.03, 0.25);
    }
  }
  return m;
}

Mesh make_crates(Rng& rng) {
  Mesh m;
  const auto crate = [&](double x, double y, double z, double s, int material) {
    const Vec3 l(x, y, z);
    const Vec3 h = l + Vec3(s, s, s);
    m.panel({l.x(), l.y(), l.z()}, {h.x(), l.y(), l.z()}, {h.x(), l.y(), h.z()},
            {l.x(), l.y(), h.z()}, material);
    m.panel({h.x(), l.y(), l.z()}, {h.x(), h.y(), l.z()}, {h.x(), h.y(), h.z()},
            {h.x(), l.y(), h.z()}, material);
    m.panel({h.x(), h.y(), l.z()}, {l.x(), h.y(), l.z()}, {l.x(), h.y(), h.z()},
            {h.x(), h.y(), h.z()}, material);
    m.panel({l.x(), h.y(), l.z()}, {l.x(), l.y(), l.z()}, {l.x(), l.y(), h.z()},
            {l.x(), h.y(), h.z()}, material);
    m.panel({l.x(), l.y(), h.z()}, {h.x(), l.y(), h.z()}, {h.x(), h.y(), h.z()},
            {l.x(), h.y(), h.z()}, material);
  };
  const double s = 0.8;
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 2; ++j) {
      const int high = 1 + rng.below(3);
      for (int k = 0; k < high; ++k) {
        const int material = rng.chance(0.6) ? kCrate : kRackLoad0 + rng.below(2);
        const double offset = rng.uniform(-0.03, 0.03);
        crate(-0.83 + 0.85 * i + offset, -0.83 + 0.85 * j, s * k, s - 0.02, material);
      }
    }
  }
  return m;
}

Mesh make_table(Rng& rng) {
  Mesh m;
  m.box({-0.9, -0.45, 0.72}, {0.9, 0.45, 0.77}, kWood);
  for (const double x : {-0.85, 0.79}) {
    for (const double y : {-0.4, 0.34}) m.box({x, y, 0}, {x + 0.06, y + 0.06, 0.72}, kMetal);
  }
  for (int i = 0; i < 4; ++i) {
    const double x = -0.8 + 0.42 * i;
    const double length = rng.uniform(0.15, 0.35);
    const double far = rng.uniform(0.1, 0.4);
    const double height = rng.uniform(0.05, 0.4);
    const double near = rng.uniform(-0.4, 0);
    m.box({x, near, 0.77}, {x + length, far, 0.77 + height}, i % 2 == 0 ? kCardboard : kMachine);
  }
  return m;
}

Mesh make_chair() {
  Mesh m;
  m.box({-0.22, -0.22, 0.44}, {0.22, 0.22, 0.49}, kCloth2);
  m.box({-0.24, -0.22, 0.55}, {-0.20, 0.22, 0.95}, kCloth1);
  for (const double x : {-0.21, 0.18}) {
    for (const double y : {-0.21, 0.18}) m.box({x, y, 0}, {x + 0.03, y + 0.03, 0.44}, kMetal);
  }
  m.box({-0.23, -0.2, 0.44}, {-0.21, -0.17, 0.95}, kMetal);
  m.box({-0.23, 0.17, 0.44}, {-0.21, 0.2, 0.95}, kMetal);
  return m;
}

Mesh make_machine(Rng& rng) {
  Mesh m;
  m.box({-1.1, -0.7, 0}, {1.1, 0.7, 1.5}, kMachine);
  m.box({-0.5, -0.5, 1.5}, {0.9, 0.4, rng.uniform(1.9, 2.4)}, kMachine);
  m.tube({-0.8, 0, 1.5}, {-0.8, 0, 2.6}, 0.16, 0.16, 14, kMetal);
  m.tube({-0.8, 0, 2.5}, {0.3, 0, 2.5}, 0.1, 0.1, 12, kMetal);
  m.box({1.1, -0.4, 0.4}, {1.4, 0.4, 1.1}, kRackLoad0);
  return m;
}

void furnish(Scene& scene, const HallObjects& o, std::uint64_t seed) {
  Rng rng(hash_of(seed, 505));
  const auto put = [&](Mesh mesh, int object, double x, double y, double heading) {
    scene.place(scene.add_prototype(std::move(mesh)), object, ground_pose(x, y, 0, heading));
  };
  for (int i = 0; i < 5; ++i) {
    put(make_rack(rng), o.shelf, -9.2 + 3.3 * i, kWidth / 2 - 0.75, std::numbers::pi);
    put(make_rack(rng), o.shelf, -6.0 + 3.3 * i, -kWidth / 2 + 0.75, 0);
  }
  for (const double x : {-8.4, 8.4}) {
    for (const double y : {-4.4, 4.4}) {
      Mesh pillar;
      pillar.box({-0.3, -0.3, 0}, {0.3, 0.3, kHeight - 0.5}, kConcrete);
      for (const double s : {-0.306, 0.306}) {  // a band of paint
        pillar.box({s - 0.002, -0.25, 1.2}, {s + 0.002, 0.25, 1.9}, kRoadPaint);
      }
      put(std::move(pillar), o.wall, x, y, 0);
    }
  }
  put(make_crates(rng), o.post, 4.3, 0.2, 0.3);
  put(make_crates(rng), o.post, -4.2, -0.3, -0.2);
  put(make_crates(rng), o.post, -10.6, 2.0, 0.1);
  put(make_crates(rng), o.post, 10.8, -1.2, 0.5);
  put(make_crates(rng), o.post, 0.2, 5.2, 0.1);
  put(make_machine(rng), o.post, 10.8, 2.6, std::numbers::pi / 2);
  put(make_machine(rng), o.post, -10.8, -2.4, -std::numbers::pi / 2);
  put(make_machine(rng), o.post, 0.6, -5.0, 0.0);
  const int chair = scene.add_prototype(make_chair());
  for (const Vec2& p : {Vec2(4.0, 4.9), Vec2(-4.4, 4.9), Vec2(6.5, -4.8), Vec2(-9.9, 5.0)}) {
    const double turn = rng.uniform(-0.2, 0.2);
    put(make_table(rng), scene.add_object(kTableClass), p.x(), p.y(), turn);
    scene.place(chair, scene.add_object(kChair), ground_pose(p.x() - 0.4, p.y() - 0.7, 0, 1.5));
    scene.place(chair, scene.add_object(kChair), ground_pose(p.x() + 1.2, p.y() + 0.1, 0, 3.0));
  }
  const int planter = scene.add_prototype(make_planter(hash_of(seed, 506)));
  for (const Vec2& p : {Vec2(11.3, 5.9), Vec2(-11.3, -5.9), Vec2(11.3, -5.6)}) {
    scene.place(planter, scene.add_object(kPottedPlant), ground_pose(p.x(), p.y(), 0, 0.4));
  }
  const MoverMeshes movers = add_mover_meshes(scene);
  add_person(scene, movers.people[3], {8.5, 5.4}, std::numbers::pi, 0.7, 0, 0.4);
  add_person(scene, movers.people[0], {-7.6, -4.9}, 1.2, 0, 0, 0);
}

HallObjects build_hall(Scene& scene, std::uint64_t seed) {
  HallObjects o{};
  o.floor = scene.add_object(kFloorOther);
  o.wall = scene.add_object(kWallOther);
  o.ceiling = scene.add_object(kCeilingClass);
  o.post = scene.add_object(kUnlabelled);
  o.shelf = scene.add_object(kShelf);
  Rng rng(hash_of(seed, 507));
  const double x = kLength / 2;
  const double y = kWidth / 2;
  Mesh walls;
  // Seen from inside: `right` runs to the right for who looks at the wall.
  wall_with_things(walls, {-x, y, 0}, {1, 0, 0}, kLength, rng);
  wall_with_things(walls, {x, y, 0}, {0, -1, 0}, kWidth, rng);
  wall_with_things(walls, {x, -y, 0}, {-1, 0, 0}, kLength, rng);
  wall_with_things(walls, {-x, -y, 0}, {0, 1, 0}, kWidth, rng);
  scene.place(scene.add_prototype(std::move(walls)), o.wall, Rigid3());
  scene.place(scene.add_prototype(make_shell_floor()), o.floor, Rigid3());
  scene.place(scene.add_prototype(make_ceiling()), o.ceiling, Rigid3());
  furnish(scene, o, seed);
  return o;
}

// The left camera on an eight through the hall; it starts slowly.
Rigid3 drone_camera(double t) {
  const double ramp = 2.5;
  const double s = t < ramp ? t * t / (2 * ramp) : t - ramp / 2;
  const double w = 2 * std::numbers::pi / kPeriod;
  const auto place = [&](double a) {
    return Vec3(6.2 * std::sin(w * a), 3.1 * std::sin(2 * w * a),
                1.75 + 0.55 * std::sin(1.7 * w * a + 0.4) + 0.2 * std::sin(5.1 * w * a));
  };
  const Vec3 velocity = (place(s + 0.05) - place(s - 0.05)) / 0.1;
  const double yaw = std::atan2(velocity.y(), velocity.x()) + 0.22 * std::sin(0.8 * s);
  const double pitch = 0.07 + 0.11 * std::sin(0.9 * s + 0.5) + 0.03 * std::sin(3.1 * s);
  const double roll = 0.13 * std::sin(0.7 * s + 1.0) + 0.04 * std::sin(2.3 * s);
  const Eigen::Quaterniond q =
      Eigen::AngleAxisd(yaw, Vec3::UnitZ()) * Eigen::AngleAxisd(pitch, Vec3::UnitY()) *
      Eigen::AngleAxisd(roll, Vec3::UnitX()) * Eigen::Quaterniond(vehicle_from_camera());
  return {q, place(s)};
}

}  // namespace

World make_hall(const WorldOptions& options) {
  World world;
  world.name = "hall";
  world.seed = options.seed;
  world.layout = Layout::kEuroc;
  const int width = options.width > 0 ? options.width : kEurocWidth;
  const int height = options.height > 0 ? options.height : kEurocHeight;
  const Rigid3 T_b_l = euroc_extrinsics(0);
  world.rig = {CameraModel(width, height, euroc_lens(0, width, height)),
               CameraModel(width, height, euroc_lens(1, width, height)),
               T_b_l.inverse() * euroc_extrinsics(1)};
  const StereoRectifier rectifier = euroc_rectifier(width, height);
  const StereoCamera& k = rectifier.camera();
  world.rectified = k;
  world.truth_rig.left = pinhole(k);
  world.truth_rig.right = world.truth_rig.left;
  world.truth_rig.T_left_right = Rigid3(Eigen::Quaterniond::Identity(), Vec3(k.baseline, 0, 0));

  world.scene.materials = make_materials(hash_of(options.seed, 1));
  world.scene.light.to_sun = Vec3(0.35, 0.28, 0.9).normalized();
  world.scene.light.shadow_ceiling = kHeight - 0.6;
  world.scene.light.sun = 0.75F;
  world.scene.light.ambient = 0.62F;
  build_hall(world.scene, options.seed);

  const int frames = options.frames > 0 ? options.frames : 500;
  for (int i = 0; i < frames; ++i) {
    const double t = i / kRate;
    world.times.push_back(t);
    world.T_w_c.push_back(drone_camera(t));
    world.T_w_b.push_back(world.T_w_c.back() * T_b_l.inverse());
    world.T_w_truth.push_back(world.T_w_b.back() * rectifier.T_b_c());
  }
  return world;
}

}  // namespace kys_slam::simulator
