// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "simulator/common/feature_path.h"

namespace kys_slam::simulator {

/// Classes of the static world around a path: road, pavement, grass, houses, trees, walls, and
/// posts, which have no class; indoors floor, walls, shelves, tables. All points in a cell of a few
/// metres have the same class.
class Scenery {
 public:
  Scenery(const FeaturePath& path, std::uint64_t seed);

  /// Dense class index of a point of the static world (m); kys::kVoidLabel: a post.
  [[nodiscard]] std::uint16_t label_of(const Eigen::Vector3d& p_w) const;
  /// The same for a pixel without a landmark: the class at 20 m distance, or that of the ground.
  [[nodiscard]] std::uint16_t label_at(std::size_t frame, double u, double v) const;

 private:
  struct Foot {
    double aside = 1e9;  ///< m from the camera's path, to the right
    double below = 0;    ///< m below the camera
  };
  [[nodiscard]] Foot foot_of(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] std::uint16_t of_road(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] std::uint16_t of_room(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] double chance_of(const Eigen::Vector3d& p_w, double cell) const;

  FeaturePath path_;
  std::uint64_t seed_;
  std::vector<Rigid3> samples_;  ///< of the path, every 2 m
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;
  Eigen::Vector3d low_ = Eigen::Vector3d::Zero(),
                  high_ = Eigen::Vector3d::Zero();  ///< bounds of an indoor world
};

}  // namespace kys_slam::simulator
