#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "feature_world.h"

namespace kys_slam::simulator {

/// What the static world around a path is made of: road, pavement, grass, houses, trees, walls, and
/// posts, which have no class; in a room floor, walls, shelves, tables. A class holds for a cell of
/// a few metres, so that neighbours belong together.
class Scenery {
 public:
  Scenery(const FeaturePath& path, std::uint64_t seed);

  /// Dense class index of a point of the static world (m); kys::kVoidLabel: a post.
  [[nodiscard]] std::uint16_t label_of(const Eigen::Vector3d& p_w) const;
  /// The same of a pixel of a frame where no landmark is: of what stands there, 20 m away, or of
  /// the ground.
  [[nodiscard]] std::uint16_t label_at(std::size_t frame, double u, double v) const;

 private:
  struct Foot {
    double aside = 1e9;  ///< m from the camera's way, to the right
    double below = 0;    ///< m below the camera
  };
  [[nodiscard]] Foot foot_of(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] std::uint16_t of_road(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] std::uint16_t of_room(const Eigen::Vector3d& p_w) const;
  [[nodiscard]] double chance_of(const Eigen::Vector3d& p_w, double cell) const;

  FeaturePath path_;
  std::uint64_t seed_;
  std::vector<Rigid3> samples_;  ///< of the way, every two metres
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;
  Eigen::Vector3d low_ = Eigen::Vector3d::Zero(), high_ = Eigen::Vector3d::Zero();  ///< of a room
};

}  // namespace kys_slam::simulator
