// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace kys_slam::simulator {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;

/// Triangles with texture coordinates and a material each. Texture coordinates are in m on building
/// surfaces and fractions on panels; the material has the scale.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector2f> uvs;                     ///< one per vertex
  std::vector<Eigen::Vector3f> normals;                 ///< one per vertex; zero: flat
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise from outside
  std::vector<std::uint16_t> materials;                 ///< one per triangle

  /// Corner a is the lower left one, then counter-clockwise seen from outside.
  void quad(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material,
            const Vec2& uv_a, const Vec2& uv_b, const Vec2& uv_c, const Vec2& uv_d);
  /// The same with texture coordinates in metres along a-b and a-d, from `origin`.
  void quad_metric(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material,
                   const Vec2& origin = Vec2::Zero());
  /// The same with texture coordinates 0..1.
  void panel(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material);
  /// Box from `low` to `high`, texture in metres; without the bottom when `open_bottom`.
  void box(const Vec3& low, const Vec3& high, int material, bool open_bottom = false);
  /// Cylinder or cone frustum between two points; texture in metres.
  void tube(const Vec3& from, const Vec3& to, double radius_from, double radius_to, int sides,
            int material, bool caps = true, int cap_material = -1);
  /// Ellipsoid with smooth normals; `bump` displaces vertices by hash noise (fraction).
  void ellipsoid(const Vec3& centre, const Vec3& radii, int rings, int sectors, int material,
                 double bump = 0, std::uint64_t seed = 0);
  /// Flat convex polygon, counter-clockwise from above, texture = x, y in metres.
  void floor_polygon(const std::vector<Vec2>& corners, double z, int material);

  void append(const Mesh& other);
};

}  // namespace kys_slam::simulator
