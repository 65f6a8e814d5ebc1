// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include <Eigen/Core>
#include <span>
#include <vector>

#include "rig_costs.h"

namespace kys_slam {

/// Memory of the parameter blocks of maps that are adjusted together. Ceres takes the blocks of a
/// group in the order of their addresses: landmarks of all maps lie in one array here, all other
/// blocks in a second, so that the order is that of the maps in every run.
class BlockMemory {
 public:
  explicit BlockMemory(std::span<const MapObservations* const> maps);
  explicit BlockMemory(const MapObservations& map);
  BlockMemory(const BlockMemory&) = delete;
  BlockMemory& operator=(const BlockMemory&) = delete;

  [[nodiscard]] double* shape() { return others_.data(); }
  /// The next of the maps: its landmarks, and its poses with its own parameters behind them.
  std::span<Eigen::Vector3d> take_points(const MapObservations& map);
  double* take_others(const MapObservations& map);

 private:
  std::vector<Eigen::Vector3d> points_;
  std::vector<double> others_;
  std::size_t next_point_ = 0, next_other_ = kShapeSize;
};

}  // namespace kys_slam
