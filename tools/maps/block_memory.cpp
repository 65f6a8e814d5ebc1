// SPDX-License-Identifier: BSD-3-Clause
#include "block_memory.h"

#include <array>
#include <utility>

namespace kys_slam {

BlockMemory::BlockMemory(std::span<const MapObservations* const> maps) {
  std::size_t points = 0, others = kShapeSize;
  for (const MapObservations* map : maps) {
    points += map->landmarks.size();
    others += kPoseSize * map->T_c_w.size() + kOwnSize;
  }
  points_.resize(points);
  others_.assign(others, 0);
}

BlockMemory::BlockMemory(const MapObservations& map) : BlockMemory(std::array{&map}) {}

std::span<Eigen::Vector3d> BlockMemory::take_points(const MapObservations& map) {
  const std::size_t begin = std::exchange(next_point_, next_point_ + map.landmarks.size());
  return std::span(points_).subspan(begin, map.landmarks.size());
}

double* BlockMemory::take_others(const MapObservations& map) {
  const std::size_t size = kPoseSize * map.T_c_w.size() + kOwnSize;
  return others_.data() + std::exchange(next_other_, next_other_ + size);
}

}  // namespace kys_slam
