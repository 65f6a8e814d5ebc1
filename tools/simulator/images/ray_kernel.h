// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "simulator/worlds/scene.h"

namespace kys_slam::simulator {

inline constexpr int kPacket = 8;  ///< rays traced together

/// Eight rays and their hits. Directions need not be of unit length; `t` counts in them.
struct RayPacket {
  std::array<float, kPacket> ox, oy, oz, dx, dy, dz;
  std::array<float, kPacket> t;  ///< in: farthest; out: hit, unchanged without one
  std::array<float, kPacket> u, v;
  std::array<int, kPacket> instance;  ///< -1: nothing hit
  std::array<int, kPacket> triangle;
  std::array<bool, kPacket> active;
};

/// Acceleration structures of all meshes of a scene; built once, shared by all threads.
class RayMeshes {
 public:
  explicit RayMeshes(const Scene& scene);
  ~RayMeshes();
  struct Impl;
  [[nodiscard]] const Impl& impl() const { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// The scene at one time, for one thread. The structure is rebuilt for every time by one thread, so
/// that hits do not depend on the history or on the number of threads.
class RayScene {
 public:
  RayScene(const RayMeshes& meshes, const Scene& scene);
  ~RayScene();
  void set_time(double time);

  void intersect(RayPacket& rays) const;
  /// Marks in `blocked` the active rays that hit anything nearer than t.
  void occluded(const RayPacket& rays, std::array<bool, kPacket>& blocked) const;

  /// T_w_o of each instance at the moment set.
  [[nodiscard]] const std::vector<Rigid3>& poses() const { return poses_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  const Scene& scene_;
  std::vector<Rigid3> poses_;
};

}  // namespace kys_slam::simulator
