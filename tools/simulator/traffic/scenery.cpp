// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/scenery.h"

#include <kys/prior.h>

#include <algorithm>
#include <cmath>

#include "simulator/common/coco_classes.h"
#include "simulator/common/rng.h"
#include "simulator/traffic/drive_path.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kCell = 16;        // m, of the index of the way
constexpr double kUsualDepth = 20;  // m, of what a pixel shows where nothing is known
constexpr double kOnGround = 0.2;   // m

std::uint64_t key_of(int x, int z) {
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32) |
         static_cast<std::uint32_t>(z);
}
int cell_of(double x) {
  return static_cast<int>(std::floor(x / kCell));
}

}  // namespace

Scenery::Scenery(const FeaturePath& path, std::uint64_t seed) : path_(path), seed_(seed) {
  if (path.ground > 0) {
    const DrivePath road(path.poses);
    for (double s = -4; s <= road.length() + path.far; s += 2) {
      const Rigid3 T = road.at(s);
      cells_[key_of(cell_of(T.t().x()), cell_of(T.t().z()))].push_back(
          static_cast<std::uint32_t>(samples_.size()));
      samples_.push_back(T);
    }
    return;
  }
  low_ = high_ = path.poses.front().T_w_c.t();
  for (const TimedPose& pose : path.poses) {
    low_ = low_.cwiseMin(pose.T_w_c.t());
    high_ = high_.cwiseMax(pose.T_w_c.t());
  }
}

Scenery::Foot Scenery::foot_of(const Vector3d& p_w) const {
  Foot foot;
  double nearest = 1e18;
  const int x = cell_of(p_w.x());
  const int z = cell_of(p_w.z());
  for (int i = x - 1; i <= x + 1; ++i) {
    for (int k = z - 1; k <= z + 1; ++k) {
      const auto found = cells_.find(key_of(i, k));
      if (found == cells_.end()) continue;
      for (const std::uint32_t at : found->second) {
        const Rigid3& T = samples_[at];
        const double d = (p_w - T.t()).squaredNorm();
        if (d >= nearest) continue;
        nearest = d;
        const Vector3d p = T.inverse() * p_w;
        foot = {p.x(), p.y()};
      }
    }
  }
  return foot;
}

// A number from 0 to 1 that belongs to a cell of space.
double Scenery::chance_of(const Vector3d& p_w, double cell) const {
  const Eigen::Vector3i c = (p_w / cell).array().floor().cast<int>();
  const auto n = [](int v) { return static_cast<std::uint64_t>(static_cast<std::uint32_t>(v)); };
  return Rng(hash_of(hash_of(seed_, 25), n(c.x()), n(c.y()), n(c.z()))).uniform();
}

std::uint16_t Scenery::of_road(const Vector3d& p_w) const {
  const Foot foot = foot_of(p_w);
  if (std::abs(foot.below - path_.ground) < kOnGround || foot.below > path_.ground) {
    if (foot.aside > -5.2 && foot.aside < 2.2) return coco_label(kRoad);
    if (foot.aside > -8.5 && foot.aside < 6) return coco_label(kPavementClass);
    return coco_label(kGrassClass);
  }
  const Vector3d flat(p_w.x(), 0, p_w.z());
  if (chance_of(flat, 0.7) < 0.175) return kys::kVoidLabel;  // a post
  const double block = chance_of(flat, 9);
  if (foot.below > path_.ground - 1.3 && block < 0.3) return coco_label(kFenceClass);
  return coco_label(block < 0.62 ? kBuilding : kTree);
}

std::uint16_t Scenery::of_room(const Vector3d& p_w) const {
  const double height = p_w.z();  // the ground truth of rooms has z up
  if (height < low_.z() + 0.1) return coco_label(kFloorOther);
  if (height > high_.z() + 1.5) return coco_label(kCeilingClass);
  const double block = chance_of(p_w, 1.5);
  if (block < 0.15) return coco_label(kShelf);
  if (block < 0.25) return coco_label(kTableClass);
  return coco_label(kWallOther);
}

std::uint16_t Scenery::label_of(const Vector3d& p_w) const {
  return path_.ground > 0 ? of_road(p_w) : of_room(p_w);
}

std::uint16_t Scenery::label_at(std::size_t frame, double u, double v) const {
  const StereoCamera& k = path_.camera;
  const double down = (v - k.cy) / k.fy;
  double depth = std::min(kUsualDepth, 0.5 * path_.far);
  if (path_.ground > 0 && depth * down > path_.ground) depth = path_.ground / down;
  return label_of(path_.poses[frame].T_w_c * k.back_project(u, v, depth));
}

}  // namespace kys_slam::simulator
