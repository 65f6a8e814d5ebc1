// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/props.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulator/common/rng.h"
#include "simulator/shapes/materials.h"

namespace kys_slam::simulator {
namespace {

// A cross-section of a car body at one x: bottom, belt line and top heights, and half widths.
struct Station {
  double x, bottom, belt, top;
  double half_low, half_belt, half_top;
  int side;   // material of the flank above the belt up to the next station
  int above;  // material of the top surface up to the next station
};

void wheel(Mesh& mesh, double x, double y, double radius) {
  const double out = y > 0 ? 1 : -1;
  mesh.tube({x, y - out * 0.2, radius}, {x, y + out * 0.012, radius}, radius, radius, 20, kRubber,
            true, kRim);
  // The dark arch around it.
  mesh.tube({x, y - out * 0.3, radius}, {x, y + out * 0.004, radius}, radius * 1.16, radius * 1.16,
            20, kBlack, true, kBlack);
}

void loft(Mesh& mesh, const std::vector<Station>& stations) {
  const double x0 = stations.front().x;
  const double length = stations.back().x - x0;
  for (std::size_t i = 0; i + 1 < stations.size(); ++i) {
    const Station& a = stations[i];
    const Station& b = stations[i + 1];
    const double ua = (a.x - x0) / length;
    const double ub = (b.x - x0) / length;
    for (const double s : {1.0, -1.0}) {
      const Vec3 a0(a.x, s * a.half_low, a.bottom), a1(a.x, s * a.half_belt, a.belt);
      const Vec3 a2(a.x, s * a.half_top, a.top);
      const Vec3 b0(b.x, s * b.half_low, b.bottom), b1(b.x, s * b.half_belt, b.belt);
      const Vec3 b2(b.x, s * b.half_top, b.top);
      const auto side = [&](const Vec3& p, const Vec3& q, const Vec3& r, const Vec3& t, int m,
                            double low_a, double low_b, double high_a, double high_b) {
        if (s < 0) {
          mesh.quad(p, q, r, t, m, {ua, low_a}, {ub, low_b}, {ub, high_b}, {ua, high_a});
        } else {
          mesh.quad(q, p, t, r, m, {ub, low_b}, {ua, low_a}, {ua, high_a}, {ub, high_b});
        }
      };
      side(a0, b0, b1, a1, kCarSide, 0, 0, 0.99, 0.99);
      if (a.top > a.belt + 0.01 || b.top > b.belt + 0.01) {
        side(a1, b1, b2, a2, a.side, 0.02, 0.02, 0.9, 0.9);
      }
    }
    mesh.quad({a.x, a.half_top, a.top}, {a.x, -a.half_top, a.top}, {b.x, -b.half_top, b.top},
              {b.x, b.half_top, b.top}, a.above, {0.05, 0.05}, {0.95, 0.05}, {0.95, 0.95},
              {0.05, 0.95});
  }
}

void car_ends(Mesh& mesh, const Station& rear, const Station& front) {
  mesh.panel({rear.x, rear.half_low, rear.bottom}, {rear.x, -rear.half_low, rear.bottom},
             {rear.x, -rear.half_belt, rear.belt}, {rear.x, rear.half_belt, rear.belt}, kCarRear);
  mesh.panel({front.x, -front.half_low, front.bottom}, {front.x, front.half_low, front.bottom},
             {front.x, front.half_belt, front.belt}, {front.x, -front.half_belt, front.belt},
             kCarFront);
}

/// Cross sections of a car's body from the rear to the front, and where its axles are.
struct CarBody {
  std::vector<Station> stations;
  double wheel_front = 1.28, wheel_rear = -1.28;  ///< m
};

// A table: one entry per model.
CarBody car_body(CarModel model) {
  constexpr int G = kCarGlass;
  constexpr int P = kCarPaint;
  CarBody body;
  std::vector<Station>& s = body.stations;
  switch (model) {
    case CarModel::kHatchback:
      s = {{-1.98, 0.26, 0.86, 0.86, 0.74, 0.78, 0.74, P, G},
           {-1.86, 0.24, 0.95, 1.00, 0.82, 0.84, 0.72, G, G},
           {-1.45, 0.22, 0.95, 1.42, 0.84, 0.86, 0.60, G, P},
           {-0.55, 0.20, 0.93, 1.50, 0.85, 0.87, 0.62, P, P},
           {-0.48, 0.20, 0.93, 1.50, 0.85, 0.87, 0.62, G, P},
           {0.30, 0.20, 0.92, 1.45, 0.85, 0.87, 0.60, G, G},
           {1.05, 0.20, 0.92, 0.97, 0.84, 0.86, 0.70, P, P},
           {1.80, 0.22, 0.80, 0.80, 0.80, 0.80, 0.66, P, P},
           {1.98, 0.26, 0.70, 0.70, 0.70, 0.72, 0.64, P, P}};
      break;
    case CarModel::kSaloon:
      s = {{-2.30, 0.28, 0.88, 0.88, 0.74, 0.78, 0.72, P, P},
           {-2.20, 0.24, 0.94, 0.96, 0.84, 0.86, 0.72, P, P},
           {-1.60, 0.22, 0.95, 1.00, 0.87, 0.89, 0.70, G, G},
           {-0.95, 0.20, 0.94, 1.40, 0.87, 0.89, 0.60, G, P},
           {-0.25, 0.20, 0.93, 1.44, 0.87, 0.89, 0.62, P, P},
           {-0.18, 0.20, 0.93, 1.44, 0.87, 0.89, 0.62, G, P},
           {0.42, 0.20, 0.92, 1.40, 0.87, 0.89, 0.60, G, G},
           {1.15, 0.20, 0.91, 0.95, 0.86, 0.88, 0.72, P, P},
           {2.10, 0.22, 0.78, 0.78, 0.82, 0.82, 0.68, P, P},
           {2.28, 0.26, 0.68, 0.68, 0.72, 0.74, 0.66, P, P}};
      body.wheel_front = 1.42;
      body.wheel_rear = -1.40;
      break;
    case CarModel::kVan:
      s = {{-2.45, 0.32, 1.15, 2.02, 0.90, 0.95, 0.84, P, P},
           {-2.35, 0.28, 1.15, 2.10, 0.93, 0.97, 0.86, kTruckSide, P},
           {0.60, 0.26, 1.12, 2.10, 0.93, 0.97, 0.86, G, P},
           {1.25, 0.26, 1.10, 1.98, 0.93, 0.97, 0.82, G, G},
           {1.95, 0.26, 1.08, 1.15, 0.92, 0.95, 0.82, P, P},
           {2.40, 0.28, 0.95, 0.95, 0.86, 0.88, 0.76, P, P},
           {2.50, 0.32, 0.80, 0.80, 0.78, 0.80, 0.72, P, P}};
      body.wheel_front = 1.60;
      body.wheel_rear = -1.50;
      break;
    case CarModel::kEstate:
      s = {{-2.30, 0.28, 0.90, 0.92, 0.76, 0.80, 0.74, P, G},
           {-2.20, 0.24, 0.95, 1.02, 0.84, 0.87, 0.72, G, G},
           {-1.90, 0.22, 0.95, 1.44, 0.86, 0.89, 0.62, G, P},
           {-1.05, 0.20, 0.94, 1.50, 0.87, 0.89, 0.63, P, P},
           {-0.98, 0.20, 0.94, 1.50, 0.87, 0.89, 0.63, G, P},
           {-0.20, 0.20, 0.93, 1.50, 0.87, 0.89, 0.63, P, P},
           {-0.13, 0.20, 0.93, 1.50, 0.87, 0.89, 0.63, G, P},
           {0.42, 0.20, 0.92, 1.44, 0.87, 0.89, 0.60, G, G},
           {1.15, 0.20, 0.91, 0.96, 0.86, 0.88, 0.72, P, P},
           {2.05, 0.22, 0.80, 0.80, 0.82, 0.82, 0.68, P, P},
           {2.22, 0.26, 0.70, 0.70, 0.72, 0.74, 0.66, P, P}};
      body.wheel_front = 1.40;
      body.wheel_rear = -1.40;
      break;
  }
  return body;
}

}  // namespace

Mesh make_car(CarModel model) {
  const CarBody body = car_body(model);
  const std::vector<Station>& s = body.stations;
  Mesh mesh;
  loft(mesh, s);
  car_ends(mesh, s.front(), s.back());
  const double half = s[3].half_low;
  for (const double side : {1.0, -1.0}) {
    for (const double x : {body.wheel_front, body.wheel_rear})
      wheel(mesh, x, side * (half + 0.005), 0.31);
    const double mirror = 0.35 + (model == CarModel::kVan ? 0.9 : 0.4);
    const double y = side * 0.99;
    mesh.box({mirror - 0.09, std::min(y, y - side * 0.16), 0.94},
             {mirror + 0.05, std::max(y, y - side * 0.16), 1.07}, kBlack);
  }
  if (model == CarModel::kVan) {  // rear windows
    mesh.panel({-2.43, 0.75, 1.25}, {-2.43, 0.05, 1.25}, {-2.41, 0.05, 1.85}, {-2.41, 0.72, 1.85},
               kCarGlass);
    mesh.panel({-2.43, -0.05, 1.25}, {-2.43, -0.75, 1.25}, {-2.41, -0.72, 1.85},
               {-2.41, -0.05, 1.85}, kCarGlass);
    mesh.quad({-2.449, 0.95, 1.15}, {-2.449, -0.95, 1.15}, {-2.449, -0.84, 2.02},
              {-2.449, 0.84, 2.02}, kCarPaint, {0, 0}, {1.9, 0}, {1.9, 0.9}, {0, 0.9});
    // The windows again, proud of the panel.
    mesh.panel({-2.455, 0.75, 1.25}, {-2.455, 0.05, 1.25}, {-2.455, 0.05, 1.85},
               {-2.455, 0.72, 1.85}, kCarGlass);
    mesh.panel({-2.455, -0.05, 1.25}, {-2.455, -0.75, 1.25}, {-2.455, -0.72, 1.85},
               {-2.455, -0.05, 1.85}, kCarGlass);
  }
  // The dark underside keeps light out of the gap below the car.
  mesh.box({s.front().x + 0.15, -half + 0.22, 0.05}, {s.back().x - 0.15, half - 0.22, 0.3}, kBlack,
           true);
  return mesh;
}

/// Of a box-shaped body between the corners l and h, driving along x.
void rear_and_sides(Mesh& m, const Vec3& l, const Vec3& h, int rear, int side) {
  m.panel({l.x(), h.y(), l.z()}, {l.x(), l.y(), l.z()}, {l.x(), l.y(), h.z()},
          {l.x(), h.y(), h.z()}, rear);
  m.panel({l.x(), l.y(), l.z()}, {h.x(), l.y(), l.z()}, {h.x(), l.y(), h.z()},
          {l.x(), l.y(), h.z()}, side);
  m.panel({h.x(), h.y(), l.z()}, {l.x(), h.y(), l.z()}, {l.x(), h.y(), h.z()},
          {h.x(), h.y(), h.z()}, side);
}

Mesh make_truck() {
  Mesh m;
  const Vec3 l(-4.1, -1.25, 0.95), h(1.9, 1.25, 3.5);
  rear_and_sides(m, l, h, kTruckRear, kTruckSide);
  m.quad_metric({h.x(), l.y(), l.z()}, {h.x(), h.y(), l.z()}, {h.x(), h.y(), h.z()},
                {h.x(), l.y(), h.z()}, kMetal);
  m.quad_metric({l.x(), l.y(), h.z()}, {h.x(), l.y(), h.z()}, {h.x(), h.y(), h.z()},
                {l.x(), h.y(), h.z()}, kMetal);
  m.quad_metric({l.x(), h.y(), l.z()}, {h.x(), h.y(), l.z()}, {h.x(), l.y(), l.z()},
                {l.x(), l.y(), l.z()}, kBlack);
  // Cab.
  m.box({2.0, -1.2, 0.5}, {3.9, 1.2, 2.8}, kTrim);
  m.panel({3.91, -1.2, 0.5}, {3.91, 1.2, 0.5}, {3.91, 1.2, 2.8}, {3.91, -1.2, 2.8}, kTruckFront);
  for (const double s : {1.0, -1.0}) {
    const double y = s * 1.21;
    if (s < 0) {
      m.panel({2.6, y, 1.6}, {3.7, y, 1.6}, {3.6, y, 2.5}, {2.6, y, 2.5}, kCarGlass);
    } else {
      m.panel({3.7, y, 1.6}, {2.6, y, 1.6}, {2.6, y, 2.5}, {3.6, y, 2.5}, kCarGlass);
    }
    for (const double x : {3.0, -2.0, -3.1}) wheel(m, x, s * 1.2, 0.48);
    m.box({3.6, std::min(s * 1.25, s * 1.5), 1.9}, {3.8, std::max(s * 1.25, s * 1.5), 2.4}, kBlack);
  }
  m.box({-3.9, -0.8, 0.45}, {2.0, 0.8, 0.95}, kBlack);
  // Underrun bar with lamps and a plate.
  m.box({-4.05, -1.2, 0.5}, {-3.95, 1.2, 0.66}, kTrim);
  m.panel({-4.07, 0.3, 0.5}, {-4.07, -0.3, 0.5}, {-4.07, -0.3, 0.64}, {-4.07, 0.3, 0.64}, kSign1);
  m.box({-4.09, 0.8, 0.7}, {-3.95, 1.2, 0.9}, kRoadPaint);
  m.box({-4.09, -1.2, 0.7}, {-3.95, -0.8, 0.9}, kRoadPaint);
  for (const double y : {0.9, -1.1}) m.box({-3.6, y, 0.15}, {-3.57, y + 0.3, 0.6}, kBlack);
  return m;
}

Mesh make_bus() {
  Mesh m;
  const Vec3 l(-5.5, -1.27, 0.32), h(5.5, 1.27, 3.1);
  rear_and_sides(m, l, h, kBusRear, kBusSide);
  m.panel({h.x(), l.y(), l.z()}, {h.x(), h.y(), l.z()}, {h.x(), h.y(), h.z()},
          {h.x(), l.y(), h.z()}, kBusFront);
  m.quad_metric({l.x(), l.y(), h.z()}, {h.x(), l.y(), h.z()}, {h.x(), h.y(), h.z()},
                {l.x(), h.y(), h.z()}, kTrim);
  m.box({-2.5, -0.9, 3.1}, {1.0, 0.9, 3.3}, kTrim);
  m.box({-5.2, -1.0, 0.08}, {5.2, 1.0, 0.4}, kBlack);
  for (const double s : {1.0, -1.0}) {
    wheel(m, 3.4, s * 1.275, 0.48);
    wheel(m, -3.0, s * 1.275, 0.48);
  }
  return m;
}

PersonMeshes make_person(int clothes) {
  const int top = kCloth0 + clothes % 4;
  const int trousers = kCloth0 + (clothes / 2 + 1) % 4;
  PersonMeshes p;
  p.body.tube({0, 0, 0.88}, {0, 0, 1.15}, 0.155, 0.145, 12, top);
  p.body.tube({0, 0, 1.15}, {0, 0, 1.47}, 0.145, 0.19, 12, top);
  p.body.ellipsoid({0, 0, 1.46}, {0.12, 0.20, 0.07}, 6, 12, top);
  p.body.tube({0, 0, 1.48}, {0, 0, 1.58}, 0.055, 0.055, 8, kSkin);
  p.body.ellipsoid({0.01, 0, 1.67}, {0.10, 0.08, 0.12}, 8, 12, kSkin);
  p.body.ellipsoid({-0.02, 0, 1.71}, {0.10, 0.09, 0.10}, 8, 12, kHair);
  if (clothes % 3 == 0) p.body.box({-0.30, -0.15, 1.02}, {-0.13, 0.15, 1.44}, kCloth0 + 1);
  p.leg.tube({0, 0, 0.02}, {0.02, 0, -0.42}, 0.085, 0.065, 8, trousers);
  p.leg.tube({0.02, 0, -0.42}, {0, 0, -0.84}, 0.065, 0.048, 8, trousers);
  p.leg.box({-0.07, -0.045, -0.89}, {0.17, 0.045, -0.81}, kRubber);
  p.arm.tube({0, 0, 0}, {0, 0, -0.30}, 0.055, 0.045, 8, top);
  p.arm.tube({0, 0, -0.30}, {0.06, 0, -0.56}, 0.045, 0.035, 8, top);
  p.arm.ellipsoid({0.075, 0, -0.62}, {0.035, 0.03, 0.06}, 5, 8, kSkin);
  return p;
}

Mesh make_tree(std::uint64_t seed, double height) {
  Rng rng(seed);
  Mesh m;
  const double trunk = 0.36 * height;
  m.tube({0, 0, 0}, {0.05, 0.03, trunk}, 0.13, 0.10, 9, kBark, false);
  m.tube({0.05, 0.03, trunk}, {0.1, 0, 0.72 * height}, 0.10, 0.04, 7, kBark, false);
  const double spread = 0.26 * height;
  for (int i = 0; i < 7; ++i) {  // boughs and the leaf masses they carry
    const double a = 2 * std::numbers::pi * (i + 0.5 * rng.uniform()) / 6;
    const bool crown = i == 6;
    const double r = crown ? 0 : spread * rng.uniform(0.45, 0.65);
    const Vec3 c(r * std::cos(a), r * std::sin(a),
                 height * (crown ? 0.83 : rng.uniform(0.50, 0.72)));
    m.tube({0.05, 0.03, trunk * rng.uniform(0.85, 1.1)}, c, 0.05, 0.02, 5, kBark, false);
    const double k = spread * rng.uniform(0.50, 0.66);
    m.ellipsoid(c, {k, k, 0.8 * k}, 9, 14, kLeaves, 0.17, rng.bits());
    for (int j = 0; j < 95; ++j) {  // leaf sprays that break the outline
      Vec3 n = rng.gaussian3();
      n.normalize();
      const Vec3 p = c + n.cwiseProduct(Vec3(k, k, 0.8 * k)) * rng.uniform(0.88, 1.14);
      Vec3 e = rng.gaussian3();
      e = (e - 0.6 * n * n.dot(e)).normalized() * rng.uniform(0.10, 0.2);
      const Vec3 f = n.cross(e).normalized() * rng.uniform(0.06, 0.13);
      const double v = rng.uniform(0, 2), u = rng.uniform(0, 2);
      m.quad_metric(p - e - f, p + e - f, p + e + f, p - e + f, kLeaves, Vec2(u, v));
    }
  }
  return m;
}

Mesh make_street_lamp() {
  Mesh m;
  m.tube({0, 0, 0}, {0, 0, 1.0}, 0.10, 0.09, 10, kMetal);
  m.tube({0, 0, 1.0}, {0, 0, 6.6}, 0.06, 0.045, 10, kMetal, false);
  m.tube({0, 0, 6.5}, {1.5, 0, 6.9}, 0.04, 0.035, 8, kMetal);
  m.box({1.2, -0.12, 6.84}, {1.9, 0.12, 6.98}, kTrim);
  return m;
}

Mesh make_traffic_light() {
  Mesh m;
  m.tube({0, 0, 0}, {0, 0, 3.4}, 0.06, 0.06, 10, kMetal);
  m.box({0.05, -0.17, 2.35}, {0.3, 0.17, 3.35}, kBlack);
  for (int i = 0; i < 3; ++i) {
    const double z = 2.52 + 0.32 * i;
    m.tube({0.3, 0, z}, {0.34, 0, z}, 0.11, 0.11, 12, kMetal, true, i == 2 ? kRoadPaint : kMetal);
  }
  m.panel({0.302, -0.17, 2.35}, {0.302, 0.17, 2.35}, {0.302, 0.17, 2.38}, {0.302, -0.17, 2.38},
          kTrim);
  return m;
}

Mesh make_sign_post() {
  Mesh m;
  m.tube({0, 0, 0}, {0, 0, 2.9}, 0.035, 0.035, 8, kMetal);
  m.panel({0.04, -0.33, 2.2}, {0.04, 0.33, 2.2}, {0.04, 0.33, 2.86}, {0.04, -0.33, 2.86},
          kTrafficSign);
  m.quad_metric({0.035, 0.33, 2.2}, {0.035, -0.33, 2.2}, {0.035, -0.33, 2.86}, {0.035, 0.33, 2.86},
                kMetal);
  return m;
}

Mesh make_bench() {
  Mesh m;
  for (int i = 0; i < 4; ++i)
    m.box({-0.24 + 0.13 * i, -0.9, 0.43}, {-0.14 + 0.13 * i, 0.9, 0.47}, kWood);
  for (int i = 0; i < 3; ++i)
    m.box({-0.3, -0.9, 0.56 + 0.13 * i}, {-0.27, 0.9, 0.65 + 0.13 * i}, kWood);
  for (const double y : {-0.75, 0.7}) {
    m.box({-0.26, y, 0}, {-0.2, y + 0.05, 0.9}, kBlack);
    m.box({0.18, y, 0}, {0.23, y + 0.05, 0.44}, kBlack);
  }
  return m;
}

Mesh make_bin() {
  Mesh m;
  m.tube({0, 0, 0.05}, {0, 0, 0.95}, 0.22, 0.25, 14, kFence);
  m.tube({0, 0, 0.95}, {0, 0, 1.02}, 0.28, 0.2, 14, kBlack);
  return m;
}

Mesh make_planter(std::uint64_t seed) {
  Mesh m;
  m.box({-0.5, -0.5, 0}, {0.5, 0.5, 0.55}, kConcrete);
  m.ellipsoid({0, 0, 0.75}, {0.52, 0.52, 0.42}, 8, 14, kLeaves, 0.2, seed);
  return m;
}

Mesh make_bollard() {
  Mesh m;
  m.tube({0, 0, 0}, {0, 0, 0.95}, 0.06, 0.06, 10, kBlack);
  m.tube({0, 0, 0.72}, {0, 0, 0.84}, 0.064, 0.064, 10, kRoadPaint, false);
  m.ellipsoid({0, 0, 0.95}, {0.07, 0.07, 0.06}, 5, 10, kMetal);
  return m;
}

Mesh make_poster_stand(int poster) {
  Mesh m;
  m.box({-0.1, -0.7, 0.35}, {0.1, 0.7, 2.35}, kBlack);
  m.box({-0.07, -0.6, 0}, {0.07, 0.6, 0.35}, kMetal);
  const int a = kPoster0 + poster % 4;
  m.panel({0.105, -0.62, 0.45}, {0.105, 0.62, 0.45}, {0.105, 0.62, 2.25}, {0.105, -0.62, 2.25}, a);
  m.panel({-0.105, 0.62, 0.45}, {-0.105, -0.62, 0.45}, {-0.105, -0.62, 2.25}, {-0.105, 0.62, 2.25},
          kPoster0 + (poster + 1) % 4);
  return m;
}

Mesh make_hedge(double length, std::uint64_t seed) {
  Mesh m;
  Rng rng(seed);
  const int n = static_cast<int>(length / 0.6) + 1;
  for (int i = 0; i < n; ++i) {
    m.ellipsoid({length * (i + 0.5) / n - length / 2, 0, 0.55}, {0.5, 0.4, 0.62}, 7, 12, kLeaves,
                0.16, rng.bits());
  }
  return m;
}

}  // namespace kys_slam::simulator
