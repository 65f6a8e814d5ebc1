// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/city.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "simulator/common/coco_classes.h"
#include "simulator/shapes/building.h"

namespace kys_slam::simulator {
namespace {

using Polygon = std::vector<Vec2>;

Vec2 left_of(const Vec2& d) {
  return {-d.y(), d.x()};
}

// The part of a convex polygon where n.p >= c.
Polygon clip(const Polygon& poly, const Vec2& n, double c) {
  Polygon out;
  for (std::size_t i = 0; i < poly.size(); ++i) {
    const Vec2& a = poly[i];
    const Vec2& b = poly[(i + 1) % poly.size()];
    const double da = n.dot(a) - c;
    const double db = n.dot(b) - c;
    if (da >= 0) out.push_back(a);
    if ((da >= 0) != (db >= 0)) out.emplace_back(a + (b - a) * (da / (da - db)));
  }
  return out;
}

Polygon inset(const Polygon& poly, double distance) {
  Polygon out = poly;
  for (std::size_t i = 0; i < poly.size(); ++i) {
    const Vec2 n = left_of((poly[(i + 1) % poly.size()] - poly[i]).normalized());
    out = clip(out, n, n.dot(poly[i]) + distance);
  }
  return out;
}

// Every corner becomes an arc of kArc + 1 points.
constexpr int kArc = 8;
Polygon round_corners(const Polygon& poly, double radius) {
  Polygon out;
  for (std::size_t i = 0; i < poly.size(); ++i) {
    const Vec2& p = poly[i];
    const Vec2 a = (poly[(i + poly.size() - 1) % poly.size()] - p).normalized();
    const Vec2 b = (poly[(i + 1) % poly.size()] - p).normalized();
    const double half = std::acos(std::clamp(a.dot(b), -1.0, 1.0)) / 2;
    const double tangent = radius / std::tan(half);
    const Vec2 centre = p + (a + b).normalized() * (radius / std::sin(half));
    const Vec2 from = p + a * tangent - centre;
    const double sweep = std::numbers::pi - 2 * half;
    for (int k = 0; k <= kArc; ++k) {
      const double t = sweep * k / kArc;
      out.emplace_back(centre + Vec2(from.x() * std::cos(t) - from.y() * std::sin(t),
                                     from.x() * std::sin(t) + from.y() * std::cos(t)));
    }
  }
  return out;
}

struct Footprint {
  Vec2 corners[4];
};

bool overlap(const Footprint& a, const Footprint& b) {
  for (int k = 0; k < 4; ++k) {
    const Footprint& f = k < 2 ? a : b;
    const Vec2 axis = (f.corners[k % 2 + 1] - f.corners[k % 2]).normalized();
    double a0 = 1e9, a1 = -1e9, b0 = 1e9, b1 = -1e9;
    for (int i = 0; i < 4; ++i) {
      a0 = std::min(a0, axis.dot(a.corners[i]));
      a1 = std::max(a1, axis.dot(a.corners[i]));
      b0 = std::min(b0, axis.dot(b.corners[i]));
      b1 = std::max(b1, axis.dot(b.corners[i]));
    }
    if (a1 < b0 + 0.02 || b1 < a0 + 0.02) return false;
  }
  return true;
}

class TownBuilder {
 public:
  TownBuilder(Scene& scene, const TownPlan& plan, std::uint64_t seed)
      : scene_(scene), plan_(plan), rng_(hash_of(seed, 101)) {
    o_.road = scene.add_object(kRoad);
    o_.pavement = scene.add_object(kPavementClass);
    o_.building = scene.add_object(kBuilding);
    o_.tree = scene.add_object(kTree);
    o_.post = scene.add_object(kUnlabelled);
    o_.fence = scene.add_object(kFenceClass);
    for (int i = 0; i < 5; ++i) {
      trees_.push_back(scene.add_prototype(make_tree(hash_of(seed, 55, i), 7.5 + 0.7 * i)));
    }
    for (int i = 0; i < 4; ++i) {
      cars_.push_back(scene.add_prototype(make_car(static_cast<CarModel>(i))));
      stands_.push_back(scene.add_prototype(make_poster_stand(i)));
    }
    lamp_ = scene.add_prototype(make_street_lamp());
    light_ = scene.add_prototype(make_traffic_light());
    sign_ = scene.add_prototype(make_sign_post());
    bench_ = scene.add_prototype(make_bench());
    bin_ = scene.add_prototype(make_bin());
    bollard_ = scene.add_prototype(make_bollard());
    for (int i = 0; i < 2; ++i) {
      planters_.push_back(scene.add_prototype(make_planter(hash_of(seed, 77, i))));
      hedges_.push_back(scene.add_prototype(make_hedge(5.0, hash_of(seed, 78, i))));
    }
  }

  TownObjects build() {
    ground();
    for (std::size_t i = 0; i <= plan_.first.size(); ++i) {
      for (std::size_t j = 0; j <= plan_.second.size(); ++j) {
        Polygon p = {{-320, -320}, {320, -320}, {320, 320}, {-320, 320}};
        p = between(p, plan_.first, i);
        p = between(p, plan_.second, j);
        if (p.size() >= 3) block(p);
      }
    }
    for (const Road& r : plan_.first) markings(r, plan_.second);
    for (const Road& r : plan_.second) markings(r, plan_.first);
    return o_;
  }

 private:
  // The part between road i-1 and road i of a family.
  static Polygon between(Polygon p, const std::vector<Road>& roads, std::size_t i) {
    if (i > 0) {  // right of the road before
      const Vec2 n = -left_of(roads[i - 1].direction);
      p = clip(p, n, n.dot(roads[i - 1].point) + kRoadHalfWidth);
    }
    if (i < roads.size()) {
      const Vec2 n = left_of(roads[i].direction);
      p = clip(p, n, n.dot(roads[i].point) + kRoadHalfWidth);
    }
    return p;
  }

  [[nodiscard]] bool within_reach(const Vec2& p, double reach) const {
    return std::any_of(plan_.near.begin(), plan_.near.end(),
                       [&](const Vec2& q) { return (p - q).norm() < reach; });
  }

  void ground() {
    Mesh m;
    m.floor_polygon({{-330, -330}, {330, -330}, {330, 330}, {-330, 330}}, 0, kAsphalt);
    scene_.place(scene_.add_prototype(std::move(m)), o_.road, Rigid3());
  }

  void block(const Polygon& outline) {
    pavement(outline);
    const Polygon front = inset(outline, 3.6);
    if (front.size() < 3) return;
    for (std::size_t i = 0; i < front.size(); ++i) {
      const Vec2& a = front[i];
      const Vec2& b = front[(i + 1) % front.size()];
      if (a.cwiseAbs().maxCoeff() > 310 && b.cwiseAbs().maxCoeff() > 310 &&
          (std::abs(a.x() - b.x()) < 1e-6 || std::abs(a.y() - b.y()) < 1e-6)) {
        continue;  // the rim of the world
      }
      houses(front, a, b);
    }
    for (std::size_t i = 0; i < outline.size(); ++i) {
      kerbside(outline[i], outline[(i + 1) % outline.size()]);
    }
  }

  void pavement(const Polygon& outline) {
    const double radius = 6.5;
    const Polygon outer = round_corners(outline, radius);
    const Polygon inner = round_corners(inset(outline, 0.16), radius - 0.16);
    Mesh m;
    m.floor_polygon(inner, kKerbHeight, kPavement);
    double along = 0;
    for (std::size_t i = 0; i < outer.size() && inner.size() == outer.size(); ++i) {
      const std::size_t j = (i + 1) % outer.size();
      const Vec3 a(outer[i].x(), outer[i].y(), 0), b(outer[j].x(), outer[j].y(), 0);
      const Vec3 up(0, 0, kKerbHeight);
      const Vec3 c(inner[i].x(), inner[i].y(), kKerbHeight);
      const Vec3 d(inner[j].x(), inner[j].y(), kKerbHeight);
      m.quad_metric(a, b, b + up, a + up, kKerb, {along, 0});
      m.quad_metric(a + up, b + up, d, c, kKerb, {along, 0.2});
      along += (b - a).norm();
    }
    scene_.place(scene_.add_prototype(std::move(m)), o_.pavement, Rigid3());
  }

  void houses(const Polygon& area, const Vec2& a, const Vec2& b) {
    const Vec2 d = (b - a).normalized();
    const double length = (b - a).norm();
    const double heading = std::atan2(d.y(), d.x());
    double s = 0.2;
    int style = rng_.below(kHouseStyles);
    int run = 0;
    while (s < length - 8) {
      if (!within_reach(a + d * s, plan_.reach)) {
        s += 4;
        continue;
      }
      if (run <= 0) {  // rows of two or three equal houses
        style = (style + 1 + rng_.below(kHouseStyles - 1)) % kHouseStyles;
        run = 1 + rng_.below(3);
      }
      const double width = std::round(rng_.uniform(10, 17));
      const double depth = 9.0;
      Footprint f;
      f.corners[0] = a + d * s;
      f.corners[1] = f.corners[0] + d * width;
      f.corners[2] = f.corners[1] + left_of(d) * depth;
      f.corners[3] = f.corners[0] + left_of(d) * depth;
      if (!fits(area, f)) {
        s += 0.7;
        continue;
      }
      built_.push_back(f);
      Rng own(rng_.bits());
      const int mesh = scene_.add_prototype(make_house(house_style(style), width, depth, own));
      scene_.place(mesh, o_.building,
                   ground_pose(f.corners[0].x(), f.corners[0].y(), kKerbHeight, heading));
      --run;
      s += width;
      if (rng_.chance(0.15)) {  // a yard behind a fence
        Mesh fence;
        fence.box({0, 0, 0}, {3.0, 0.08, 1.9}, kFence);
        const Vec2 p = a + d * s;
        scene_.place(scene_.add_prototype(std::move(fence)), o_.fence,
                     ground_pose(p.x(), p.y(), kKerbHeight, heading));
        scene_.place(trees_[rng_.below(5)], o_.tree,
                     ground_pose((p + d * 1.5 + left_of(d) * 3).x(),
                                 (p + d * 1.5 + left_of(d) * 3).y(), kKerbHeight, 1));
        s += 3.0;
      }
    }
  }

  bool fits(const Polygon& area, const Footprint& f) const {
    for (std::size_t i = 0; i < area.size(); ++i) {
      const Vec2 n = left_of((area[(i + 1) % area.size()] - area[i]).normalized());
      for (const Vec2& c : f.corners) {
        if (n.dot(c) < n.dot(area[i]) - 1e-6) return false;
      }
    }
    return std::none_of(built_.begin(), built_.end(),
                        [&](const Footprint& g) { return overlap(f, g); });
  }

  [[nodiscard]] bool is_clear(const Vec2& p) const {
    return std::none_of(plan_.keep_clear.begin(), plan_.keep_clear.end(),
                        [&](const auto& c) { return (p - c.first).norm() < c.second; });
  }

  // What stands along one kerb, and what is parked at it.
  void kerbside(const Vec2& a, const Vec2& b) {
    const Vec2 d = (b - a).normalized();
    const Vec2 in = left_of(d);
    const double length = (b - a).norm();
    const double heading = std::atan2(d.y(), d.x());
    const auto put = [&](int mesh, int object, double s, double offset, double turn,
                         double scale = 1) {
      const Vec2 p = a + d * s + in * offset;
      if (!within_reach(p, plan_.reach)) return;
      scene_.place(mesh, object,
                   ground_pose(p.x(), p.y(), offset < 0 ? 0 : kKerbHeight, heading + turn), scale);
    };
    const double half_pi = std::numbers::pi / 2;
    for (double s = 9; s < length - 9; s += 11.5) {
      const double scale = rng_.uniform(0.85, 1.1);
      const double turn = rng_.uniform(0, 2 * std::numbers::pi);
      const double along = rng_.uniform(-0.4, 0.4);
      put(trees_[rng_.below(5)], o_.tree, s + along, 0.95, turn, scale);
    }
    for (double s = 14.5; s < length - 9; s += 23) put(lamp_, o_.post, s, 0.55, -half_pi);
    for (double s = 11; s < length - 8; s += rng_.uniform(3.5, 7.5)) furniture(put, s);
    for (const double s : {7.5, length - 7.5}) {
      put(light_, scene_.add_object(kTrafficLight), s, 0.5, s < 10 ? std::numbers::pi : 0);
      for (int k = 0; k < 4; ++k)
        put(bollard_, o_.post, s + (s < 10 ? 1.6 : -1.6) * (k + 1), 0.4, 0);
    }
    parked_cars(a, d, in, length, heading);
  }

  template <typename Put>
  void furniture(const Put& put, double s) {
    const double half_pi = std::numbers::pi / 2;
    switch (rng_.below(8)) {
      case 0:
        put(sign_, o_.post, s, 0.5, rng_.chance(0.5) ? 0 : std::numbers::pi);
        break;
      case 1:
        put(bench_, scene_.add_object(kBench), s, 1.0, -half_pi);
        break;
      case 2:
        put(bin_, o_.post, s, 0.7, 0);
        break;
      case 3: {
        const double turn = rng_.uniform(-0.4, 0.4);
        put(stands_[rng_.below(4)], o_.post, s, 0.9, turn);
        break;
      }
      case 4: {
        const double turn = rng_.uniform(0, 1);
        const int object = scene_.add_object(kPottedPlant);
        put(planters_[rng_.below(2)], object, s, 2.9, turn);
        break;
      }
      case 5:
        put(sign_, o_.post, s, 0.5, rng_.chance(0.5) ? 0 : std::numbers::pi);
        break;
      case 6:
        put(hedges_[rng_.below(2)], o_.tree, s, 3.15, 0, 0.8);
        break;
      default:
        put(bollard_, o_.post, s, 0.45, 0);
        break;
    }
  }

  void parked_cars(const Vec2& a, const Vec2& d, const Vec2& in, double length, double heading) {
    if (plan_.parked <= 0) return;
    int model = rng_.below(4);
    int run = 2 + rng_.below(4);
    float tint = 0.5F;
    for (double s = 13; s < length - 13; s += 5.7) {
      if (--run <= 0) {  // the next run of identical cars
        model = rng_.below(4);
        run = 3 + rng_.below(4);
        tint = pick_tint();
        if (rng_.chance(1 - plan_.parked)) s += 6;
      }
      const Vec2 p = a + d * s - in * 1.05;
      if (!within_reach(p, plan_.reach) || !is_clear(p) || rng_.chance(0.08)) continue;
      // Right-hand traffic: the kerb is on the right of a car.
      scene_.place(
          cars_[model], scene_.add_object(kCar, true),
          ground_pose(p.x(), p.y(), 0, heading + std::numbers::pi + rng_.uniform(-0.02, 0.02)), 1,
          tint);
    }
  }

  float pick_tint() {
    constexpr float tints[] = {0.10F, 0.85F, 0.55F, 0.32F, 0.2F, 0.7F};
    return tints[rng_.below(6)];
  }

  // Dashed middle line, edge lines of the lanes, and zebras with stop lines at crossings.
  void markings(const Road& road, const std::vector<Road>& crossing) {
    std::vector<double> at;  // arc lengths of the crossings
    for (const Road& c : crossing) {
      const Vec2 n = left_of(c.direction);
      at.push_back(n.dot(c.point - road.point) / n.dot(road.direction));
    }
    const auto near_crossing = [&](double s) {
      return std::any_of(at.begin(), at.end(),
                         [&](double c) { return std::abs(s - c) < kRoadHalfWidth + 7.5; });
    };
    Mesh m;
    const Vec2 d = road.direction;
    const Vec2 l = left_of(d);
    const auto stripe = [&](double s0, double s1, double y0, double y1) {
      const auto p = [&](double s, double y) {
        const Vec2 q = road.point + d * s + l * y;
        return Vec3(q.x(), q.y(), 0.005);
      };
      m.quad_metric(p(s0, y0), p(s1, y0), p(s1, y1), p(s0, y1), kRoadPaint, {s0, y0});
    };
    for (double s = -300; s < 300; s += 6) {
      if (near_crossing(s) || near_crossing(s + 3) || !within_reach(road.point + d * s, 160)) {
        continue;
      }
      stripe(s, s + 3, -0.07, 0.07);
      for (const double y : {-3.45, 3.45}) stripe(s, s + 1.2, y - 0.05, y + 0.05);
      // Bay lines of the parking row.
      for (const double y : {-5.4, 3.5}) stripe(s + 4, s + 4.1, y, y + 1.9);
    }
    for (const double c : at) {
      for (const double side : {-1.0, 1.0}) {
        const double s = c + side * (kRoadHalfWidth + 3.0);
        for (double y = -4.8; y < 4.9; y += 1.0) {
          stripe(std::min(s, s + side * 3), std::max(s, s + side * 3), y, y + 0.5);
        }
        const double stop = s + side * 4;
        stripe(std::min(stop, stop + side * 0.4), std::max(stop, stop + side * 0.4),
               side > 0 ? 0.1 : -3.4, side > 0 ? 3.4 : -0.1);
      }
    }
    if (!m.triangles.empty()) scene_.place(scene_.add_prototype(std::move(m)), o_.road, Rigid3());
  }

  Scene& scene_;
  const TownPlan& plan_;
  Rng rng_;
  TownObjects o_{};
  std::vector<int> trees_, cars_, stands_, planters_, hedges_;
  int lamp_ = 0, light_ = 0, sign_ = 0, bench_ = 0, bin_ = 0, bollard_ = 0;
  std::vector<Footprint> built_;
};

}  // namespace

TownObjects build_town(Scene& scene, const TownPlan& plan, std::uint64_t seed) {
  return TownBuilder(scene, plan, seed).build();
}

MoverMeshes add_mover_meshes(Scene& scene) {
  MoverMeshes m;
  for (int i = 0; i < 4; ++i) {
    m.cars.push_back(scene.add_prototype(make_car(static_cast<CarModel>(i))));
  }
  m.truck = scene.add_prototype(make_truck());
  m.bus = scene.add_prototype(make_bus());
  for (int i = 0; i < 6; ++i) {
    PersonMeshes p = make_person(i);
    m.people.push_back({scene.add_prototype(std::move(p.body)),
                        scene.add_prototype(std::move(p.leg)),
                        scene.add_prototype(std::move(p.arm))});
  }
  return m;
}

int add_vehicle(Scene& scene, int prototype, int category, const Path* path, double offset,
                std::function<double(double)> s, float tint) {
  const int object = scene.add_object(category, true);
  auto shared = std::make_shared<const Path>(*path);
  scene.place_moving(
      prototype, object,
      [shared, offset, s = std::move(s)](double t) {
        const double at = s(t);
        const Vec2 p = shared->position(at, offset);
        return ground_pose(p.x(), p.y(), 0, shared->heading(at));
      },
      1, tint);
  return object;
}

int add_person(Scene& scene, const MoverMeshes::Person& meshes, const Vec2& start, double heading,
               double speed, double ground, double phase) {
  const int object = scene.add_object(kPerson, true);
  const auto at = [=](double t) {
    const double bob =
        speed > 0 ? 0.018 * std::cos(2 * (phase + 2 * std::numbers::pi * 0.95 * t)) : 0;
    return ground_pose(start.x() + std::cos(heading) * speed * t,
                       start.y() + std::sin(heading) * speed * t, ground + bob, heading);
  };
  const auto limb = [=](double side, double height, double swing, double sign) -> Motion {
    return [=](double t) {
      const double angle = speed > 0
                               ? sign * swing * std::sin(phase + 2 * std::numbers::pi * 0.95 * t)
                               : sign * 0.04;
      return at(t) * Rigid3(Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY())),
                            Eigen::Vector3d(0, side, height));
    };
  };
  scene.place_moving(meshes.body, object, at);
  scene.place_moving(meshes.leg, object, limb(0.09, kHipHeight, 0.42, 1));
  scene.place_moving(meshes.leg, object, limb(-0.09, kHipHeight, 0.42, -1));
  scene.place_moving(meshes.arm, object, limb(0.23, kShoulderHeight, 0.35, -1));
  scene.place_moving(meshes.arm, object, limb(-0.23, kShoulderHeight, 0.35, 1));
  return object;
}

}  // namespace kys_slam::simulator
