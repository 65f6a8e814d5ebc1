// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/building.h"

#include <algorithm>
#include <cmath>

#include "simulator/shapes/materials.h"

namespace kys_slam::simulator {
namespace {

// A vertical wall: `at(x, z, out)` is the point x along it, z up, `out` metres in front of it.
struct Wall {
  Vec3 origin, right, normal;
  [[nodiscard]] Vec3 at(double x, double z, double out = 0) const {
    return origin + right * x + Vec3(0, 0, z) + normal * out;
  }
};

void wall_rect(Mesh& m, const Wall& w, double x0, double z0, double x1, double z1, int material,
               double out = 0) {
  if (x1 - x0 < 1e-6 || z1 - z0 < 1e-6) return;
  m.quad_metric(w.at(x0, z0, out), w.at(x1, z0, out), w.at(x1, z1, out), w.at(x0, z1, out),
                material, {x0, z0});
}

void wall_panel(Mesh& m, const Wall& w, double x0, double z0, double x1, double z1, int material,
                double out = 0) {
  m.panel(w.at(x0, z0, out), w.at(x1, z0, out), w.at(x1, z1, out), w.at(x0, z1, out), material);
}

// A box that stands proud of the wall.
void ledge(Mesh& m, const Wall& w, double x0, double z0, double x1, double z1, double out,
           int material) {
  m.quad_metric(w.at(x0, z0, out), w.at(x1, z0, out), w.at(x1, z1, out), w.at(x0, z1, out),
                material, {x0, z0});
  m.quad_metric(w.at(x0, z1, out), w.at(x1, z1, out), w.at(x1, z1), w.at(x0, z1), material);
  m.quad_metric(w.at(x0, z0), w.at(x1, z0), w.at(x1, z0, out), w.at(x0, z0, out), material);
  m.quad_metric(w.at(x0, z0), w.at(x0, z0, out), w.at(x0, z1, out), w.at(x0, z1), material);
  m.quad_metric(w.at(x1, z0, out), w.at(x1, z0), w.at(x1, z1), w.at(x1, z1, out), material);
}

// An opening in the wall with its four reveals and what fills it.
void opening(Mesh& m, const Wall& w, double x0, double z0, double x1, double z1, double deep,
             int wall, int fill) {
  wall_panel(m, w, x0, z0, x1, z1, fill, -deep);
  m.quad_metric(w.at(x0, z0), w.at(x0, z0, -deep), w.at(x0, z1, -deep), w.at(x0, z1), wall);
  m.quad_metric(w.at(x1, z0, -deep), w.at(x1, z0), w.at(x1, z1), w.at(x1, z1, -deep), wall);
  m.quad_metric(w.at(x0, z0), w.at(x1, z0), w.at(x1, z0, -deep), w.at(x0, z0, -deep), kTrim);
  m.quad_metric(w.at(x0, z1, -deep), w.at(x1, z1, -deep), w.at(x1, z1), w.at(x0, z1), wall);
}

struct Hole {
  double x0, x1;
  int fill;
};

// One storey: wall with a row of holes between two heights.
void storey(Mesh& m, const Wall& w, double width, double z0, double z1, double low, double high,
            double deep, int wall, const std::vector<Hole>& holes) {
  wall_rect(m, w, 0, z0, width, low, wall);
  wall_rect(m, w, 0, high, width, z1, wall);
  double x = 0;
  for (const Hole& h : holes) {
    wall_rect(m, w, x, low, h.x0, high, wall);
    opening(m, w, h.x0, low, h.x1, high, deep, wall, h.fill);
    x = h.x1;
  }
  wall_rect(m, w, x, low, width, high, wall);
}

void ground_floor(Mesh& m, const Wall& w, double width, double height, const HouseStyle& s,
                  bool front, Rng& rng) {
  const int bays = std::max(1, static_cast<int>(width / s.bay));
  const double bay = width / bays;
  if (s.ground == GroundFloor::kShops && front) {
    std::vector<Hole> holes;
    const int shops = std::max(1, static_cast<int>(width / 5.0));
    const double pitch = width / shops;
    for (int i = 0; i < shops; ++i) {
      holes.push_back({i * pitch + 0.35, i * pitch + pitch - 1.55, kShop0 + rng.below(4)});
      holes.push_back({i * pitch + pitch - 1.4, i * pitch + pitch - 0.35, kDoor0 + rng.below(2)});
    }
    storey(m, w, width, 0, height, 0.12, 2.75, 0.25, s.base_wall, holes);
    for (int i = 0; i < shops; ++i) {
      const double x0 = i * pitch + 0.3;
      const double x1 = i * pitch + pitch - 0.3;
      ledge(m, w, x0, 2.85, x1, 3.55, 0.16, kTrim);
      wall_panel(m, w, x0, 2.85, x1, 3.55, kSign0 + rng.below(6), 0.165);
      if (rng.chance(0.5)) {  // an awning
        m.quad_metric(w.at(x0, 2.35, 1.1), w.at(x1, 2.35, 1.1), w.at(x1, 2.82, 0.02),
                      w.at(x0, 2.82, 0.02), kCloth1);
      }
      if (rng.chance(0.6)) {  // a sign that hangs over the pavement
        const double x = i * pitch + pitch - 0.15;
        m.panel(w.at(x, 2.9, 0.1), w.at(x, 2.9, 0.9), w.at(x, 3.5, 0.9), w.at(x, 3.5, 0.1),
                kSign0 + rng.below(6));
      }
    }
    return;
  }
  std::vector<Hole> holes;
  const int door = front ? rng.below(bays) : -1;
  for (int i = 0; i < bays; ++i) {
    if (i == door || s.ground == GroundFloor::kBlind) continue;
    const double c = (i + 0.5) * bay;
    holes.push_back({c - s.window_width / 2, c + s.window_width / 2, s.window});
  }
  storey(m, w, width, 0, height, 1.1, 1.1 + s.window_height * 0.95, 0.18, s.base_wall, holes);
  ledge(m, w, 0, 0, width, 0.55, 0.06, kStone);
  if (door >= 0) {
    const double c = (door + 0.5) * bay;
    ledge(m, w, c - 0.8, 0.02, c + 0.8, 2.75, 0.10, kTrim);
    wall_panel(m, w, c - 0.6, 0.02, c + 0.6, 2.6, kDoor0 + rng.below(2), 0.105);
    ledge(m, w, c - 1.0, 2.75, c + 1.0, 2.9, 0.7, kConcrete);
    ledge(m, w, c - 0.9, 0.0, c + 0.9, 0.16, 0.5, kStone);
  }
  if (s.ground == GroundFloor::kBlind && front) {
    for (int i = 0; i < bays; ++i) {
      if (i != door && rng.chance(0.35)) {
        const double c = (i + 0.5) * bay;
        wall_panel(m, w, c - 0.7, 0.9, c + 0.7, 2.9, kPoster0 + rng.below(4), 0.012);
      }
    }
  }
}

void balcony(Mesh& m, const Wall& w, double x0, double x1, double z) {
  ledge(m, w, x0, z - 0.14, x1, z, 0.95, kConcrete);
  const int bars = static_cast<int>((x1 - x0) / 0.16);
  for (int i = 0; i <= bars; ++i) {
    const double x = x0 + (x1 - x0) * i / bars;
    wall_rect(m, w, x - 0.012, z, x + 0.012, z + 0.95, kBlack, 0.93);
  }
  ledge(m, w, x0, z + 0.95, x1, z + 1.0, 0.95, kBlack);
}

void facade(Mesh& m, const Wall& w, double width, const HouseStyle& s, bool front, Rng& rng) {
  const double ground = s.ground == GroundFloor::kShops ? 3.9 : 3.4;
  ground_floor(m, w, width, ground, s, front, rng);
  const int bays = std::max(1, static_cast<int>(width / (front ? s.bay : 1.5 * s.bay)));
  const double bay = width / bays;
  for (int f = 0; f < s.floors; ++f) {
    const double z = ground + f * s.floor_height;
    std::vector<Hole> holes;
    for (int i = 0; i < bays; ++i) {
      const double c = (i + 0.5) * bay;
      const int pane = rng.chance(0.72) ? s.window : kWindow0 + rng.below(6);
      holes.push_back({c - s.window_width / 2, c + s.window_width / 2, pane});
    }
    const double low = z + 0.85;
    const double high = low + s.window_height;
    storey(m, w, width, z, z + s.floor_height, low, high, 0.2, s.wall, holes);
    for (int i = 0; i < bays; ++i) {
      const double c = (i + 0.5) * bay;
      const double half = s.window_width / 2 + 0.12;
      ledge(m, w, c - half, low - 0.1, c + half, low, 0.12, kTrim);
      if (s.bands) ledge(m, w, c - half, high, c + half, high + 0.18, 0.08, kTrim);
      if (s.balconies && front && i % 2 == 1)
        balcony(m, w, c - half - 0.3, c + half + 0.3, z + 0.15);
    }
    if (s.bands) ledge(m, w, 0, z - 0.12, width, z + 0.12, 0.1, kTrim);
  }
  ledge(m, w, 0, ground + s.floors * s.floor_height - 0.1, width,
        ground + s.floors * s.floor_height + 0.25, 0.28, kTrim);
  if (front && rng.chance(0.7)) {  // rain pipe
    m.tube(w.at(0.2, 0, 0.1), w.at(0.2, ground + s.floors * s.floor_height, 0.1), 0.05, 0.05, 7,
           kMetal, false);
  }
}

void roof(Mesh& m, double width, double depth, double z, const HouseStyle& s, Rng& rng) {
  if (s.roof == Roof::kFlat) {
    m.quad_metric({0, 0, z + 0.25}, {width, 0, z + 0.25}, {width, depth, z + 0.25},
                  {0, depth, z + 0.25}, kRoofFlat);
    for (int i = 0; i < 3; ++i) {
      const double x = rng.uniform(1, width - 2.5);
      const double y = rng.uniform(1.5, depth - 3);
      const int material = rng.chance(0.5) ? kMetal : kBrickRed;
      const double length = rng.uniform(0.8, 2.2);
      const double height = rng.uniform(1.2, 2.4);
      m.box({x, y, z + 0.25}, {x + length, y + 1.2, z + height}, material, true);
    }
    return;
  }
  const double ridge = z + 0.25 + 0.36 * depth;
  const double eave = z + 0.25;
  const double out = 0.35;
  const double slope = (ridge - eave) / (depth / 2);
  m.quad_metric({0, -out, eave - out * slope}, {width, -out, eave - out * slope},
                {width, depth / 2, ridge}, {0, depth / 2, ridge}, kRoofTile);
  m.quad_metric({width, depth + out, eave - out * slope}, {0, depth + out, eave - out * slope},
                {0, depth / 2, ridge}, {width, depth / 2, ridge}, kRoofTile);
  for (const double x : {0.0, width}) {  // gable ends, seen from both sides
    m.quad({x, 0, eave}, {x, depth, eave}, {x, depth / 2, ridge}, {x, depth / 2, ridge}, s.wall,
           {0, 0}, {depth, 0}, {depth / 2, ridge - eave}, {depth / 2, ridge - eave});
  }
  for (int i = 0; i < 2; ++i) {
    const double x = width * (0.25 + 0.5 * i);
    m.box({x, depth * 0.38, eave}, {x + 0.7, depth * 0.38 + 0.7, ridge + 0.9}, kBrickRed, true);
  }
  const int dormers = static_cast<int>(width / 5);
  for (int i = 0; i < dormers; ++i) {
    const double x = width * (i + 0.5) / dormers;
    const double y = 1.1;
    const double base = eave + y * slope;
    m.box({x - 0.8, y, base - 0.3}, {x + 0.8, y + 2.4, base + 1.5}, s.wall, true);
    m.panel({x - 0.6, y - 0.01, base + 0.1}, {x + 0.6, y - 0.01, base + 0.1},
            {x + 0.6, y - 0.01, base + 1.35}, {x - 0.6, y - 0.01, base + 1.35}, s.window);
  }
}

}  // namespace

HouseStyle house_style(int index) {
  using G = GroundFloor;
  using R = Roof;
  static const HouseStyle styles[kHouseStyles] = {
      {kPlasterLight, kStone, kWindow0, 3, 3.1, 2.5, 1.25, 1.75, G::kShops, R::kFlat, false, true},
      {kBrickRed, kBrickRed, kWindow1, 3, 3.0, 2.8, 1.35, 1.65, G::kDwelling, R::kGable, false,
       false},
      {kConcrete, kConcrete, kWindow4, 5, 2.9, 3.1, 1.9, 1.45, G::kShops, R::kFlat, true, false},
      {kPlasterDark, kPlasterDark, kWindow2, 2, 3.2, 2.7, 1.2, 1.8, G::kDwelling, R::kGable, false,
       true},
      {kBrickPale, kBrickPale, kWindow3, 4, 3.0, 2.4, 1.15, 1.7, G::kShops, R::kFlat, false, false},
      {kStone, kStone, kWindow5, 3, 3.5, 3.0, 1.4, 2.1, G::kDwelling, R::kFlat, false, true},
      {kPlasterLight, kBrickRed, kWindow4, 4, 2.9, 2.9, 1.5, 1.5, G::kDwelling, R::kFlat, true,
       false},
      {kBrickRed, kConcrete, kWindow0, 2, 3.6, 3.6, 2.4, 1.6, G::kBlind, R::kFlat, false, false}};
  return styles[index % kHouseStyles];
}

Mesh make_house(const HouseStyle& s, double width, double depth, Rng& rng) {
  Mesh m;
  facade(m, {{0, 0, 0}, {1, 0, 0}, {0, -1, 0}}, width, s, true, rng);
  facade(m, {{width, 0, 0}, {0, 1, 0}, {1, 0, 0}}, depth, s, false, rng);
  facade(m, {{width, depth, 0}, {-1, 0, 0}, {0, 1, 0}}, width, s, false, rng);
  facade(m, {{0, depth, 0}, {0, -1, 0}, {-1, 0, 0}}, depth, s, false, rng);
  const double z = (s.ground == GroundFloor::kShops ? 3.9 : 3.4) + s.floors * s.floor_height;
  roof(m, width, depth, z, s, rng);
  return m;
}

}  // namespace kys_slam::simulator
