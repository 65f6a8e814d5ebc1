// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/parked_cars.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "simulator/common/coco_classes.h"
#include "simulator/common/rng.h"
#include "simulator/traffic/drive_path.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

using Cells = std::map<std::pair<int, int>, std::vector<Vector3d>>;

// Whether the camera ever comes so near to the box that its car would touch it.
bool in_the_way(const Rigid3& T_w_o, const Vector3d& half, const Cells& cells, double cell) {
  const Rigid3 T_o_w = T_w_o.inverse();
  const int x = static_cast<int>(std::floor(T_w_o.t().x() / cell));
  const int z = static_cast<int>(std::floor(T_w_o.t().z() / cell));
  for (int i = x - 1; i <= x + 1; ++i) {
    for (int k = z - 1; k <= z + 1; ++k) {
      const auto found = cells.find({i, k});
      if (found == cells.end()) continue;
      for (const Vector3d& p_w : found->second) {
        const Vector3d p = (T_o_w * p_w).cwiseAbs() - half;
        if (p.x() < 1.5 && p.z() < 1.5 && p.y() < 6) return true;
      }
    }
  }
  return false;
}

}  // namespace

std::vector<FeatureObject> park_cars(const FeaturePath& path, std::uint64_t seed) {
  std::vector<FeatureObject> cars;
  if (path.ground <= 0) return cars;
  const DrivePath road(path.poses);
  constexpr double kCell = 12;
  Cells cells, parked;
  const auto put = [](Cells& to, const Vector3d& p) {
    to[{static_cast<int>(std::floor(p.x() / kCell)), static_cast<int>(std::floor(p.z() / kCell))}]
        .push_back(p);
  };
  for (double s = 0; s <= road.length(); s += 1) put(cells, road.at(s).t());
  Rng rng(hash_of(seed, 24));
  for (const double side : {1.0, -1.0}) {
    bool run = false;
    double run_end = 0;
    for (double s = 0; s < road.length(); s += 6.2) {
      if (s >= run_end) {
        run = rng.chance(0.45);
        run_end = s + rng.uniform(20, 60);
      }
      const double k = rng.uniform(0.93, 1.08);
      const bool taken = rng.chance(0.85);
      const double lateral = side > 0 ? 3.1 : kLeftLane - 3.0;
      if (!run || !taken) continue;
      const Vector3d half = k * Vector3d(0.9, 0.74, 2.15);
      const Rigid3 T_w_o =
          road.beside(s, {lateral, path.ground - half.y(), 0}, rng.uniform(-0.04, 0.04));
      if (in_the_way(T_w_o, half, cells, kCell) ||
          in_the_way(T_w_o, half + Vector3d(1, 0, 2), parked, kCell)) {
        continue;
      }
      put(parked, T_w_o.t());
      FeatureObject car;
      car.label = coco_label(kCar);
      car.half_size = half.cast<float>();
      car.poses = {T_w_o};
      cars.push_back(std::move(car));
    }
  }
  return cars;
}

}  // namespace kys_slam::simulator
