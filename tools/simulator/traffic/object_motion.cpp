// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/object_motion.h"

#include <cmath>
#include <cstdint>
#include <numbers>

namespace kys_slam::simulator {

using Eigen::Vector3d;

const Rigid3* pose_in_frame(const FeatureObject& object, std::size_t frame) {
  if (object.kind == FeatureObject::Kind::kStatic) return object.poses.data();
  const auto at = static_cast<std::int64_t>(frame) - object.first_frame;
  if (at < 0 || at >= static_cast<std::int64_t>(object.poses.size())) return nullptr;
  return &object.poses[static_cast<std::size_t>(at)];
}

Vector3d sway(const FeatureObject& object, const Vector3d& p_o, double time) {
  if (object.kind != FeatureObject::Kind::kArticulated) return p_o;
  // Arms and legs swing against each other, left against right, the more the farther from the
  // waist.
  constexpr double kStepsPerSecond = 0.95;
  const double height = p_o.y() / object.half_size.y();
  const double side = p_o.x() >= 0 ? 1 : -1;
  const double swing = 0.14 * height * side;
  return p_o + Vector3d(0, 0, swing * std::sin(2 * std::numbers::pi * kStepsPerSecond * time));
}

}  // namespace kys_slam::simulator
