// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/mesh.h"

#include <cmath>
#include <numbers>

#include "simulator/common/rng.h"

namespace kys_slam::simulator {

void Mesh::quad(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material,
                const Vec2& uv_a, const Vec2& uv_b, const Vec2& uv_c, const Vec2& uv_d) {
  const auto base = static_cast<std::uint32_t>(vertices.size());
  const Vec3* p[] = {&a, &b, &c, &d};
  const Vec2* t[] = {&uv_a, &uv_b, &uv_c, &uv_d};
  for (int i = 0; i < 4; ++i) {
    vertices.emplace_back(p[i]->cast<float>());
    uvs.emplace_back(t[i]->cast<float>());
    normals.emplace_back(Eigen::Vector3f::Zero());
  }
  triangles.push_back({base, base + 1, base + 2});
  triangles.push_back({base, base + 2, base + 3});
  materials.insert(materials.end(), 2, static_cast<std::uint16_t>(material));
}

void Mesh::quad_metric(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material,
                       const Vec2& origin) {
  const double w = (b - a).norm();
  const double h = (d - a).norm();
  quad(a, b, c, d, material, origin, origin + Vec2(w, 0), origin + Vec2(w, h), origin + Vec2(0, h));
}

void Mesh::panel(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, int material) {
  quad(a, b, c, d, material, {0, 0}, {1, 0}, {1, 1}, {0, 1});
}

void Mesh::box(const Vec3& l, const Vec3& h, int material, bool open_bottom) {
  const Vec3 p[] = {{l.x(), l.y(), l.z()}, {h.x(), l.y(), l.z()}, {h.x(), h.y(), l.z()},
                    {l.x(), h.y(), l.z()}, {l.x(), l.y(), h.z()}, {h.x(), l.y(), h.z()},
                    {h.x(), h.y(), h.z()}, {l.x(), h.y(), h.z()}};
  quad_metric(p[0], p[1], p[5], p[4], material, {l.x(), l.z()});
  quad_metric(p[1], p[2], p[6], p[5], material, {l.y(), l.z()});
  quad_metric(p[2], p[3], p[7], p[6], material, {-h.x(), l.z()});
  quad_metric(p[3], p[0], p[4], p[7], material, {-h.y(), l.z()});
  quad_metric(p[4], p[5], p[6], p[7], material, {l.x(), l.y()});
  if (!open_bottom) quad_metric(p[3], p[2], p[1], p[0], material, {l.x(), l.y()});
}

void Mesh::tube(const Vec3& from, const Vec3& to, double r0, double r1, int sides, int material,
                bool caps, int cap_material) {
  const Vec3 axis = (to - from).normalized();
  const Vec3 helper = std::abs(axis.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX();
  const Vec3 e1 = helper.cross(axis).normalized();
  const Vec3 e2 = axis.cross(e1);
  const double length = (to - from).norm();
  const auto base = static_cast<std::uint32_t>(vertices.size());
  for (int i = 0; i <= sides; ++i) {
    const double a = 2 * std::numbers::pi * i / sides;
    const Vec3 n = e1 * std::cos(a) + e2 * std::sin(a);
    for (int end = 0; end < 2; ++end) {
      vertices.emplace_back(((end == 0 ? from : to) + n * (end == 0 ? r0 : r1)).cast<float>());
      uvs.emplace_back(static_cast<float>(a * std::max(r0, r1)),
                       static_cast<float>(end == 0 ? 0 : length));
      normals.emplace_back(n.cast<float>());
    }
    if (i == sides) break;
    const std::uint32_t k = base + 2 * static_cast<std::uint32_t>(i);
    triangles.push_back({k, k + 2, k + 3});
    triangles.push_back({k, k + 3, k + 1});
    materials.insert(materials.end(), 2, static_cast<std::uint16_t>(material));
  }
  if (!caps) return;
  for (int end = 0; end < 2; ++end) {
    const Vec3 centre = end == 0 ? from : to;
    const double r = end == 0 ? r0 : r1;
    const auto start = static_cast<std::uint32_t>(vertices.size());
    vertices.emplace_back(centre.cast<float>());
    uvs.emplace_back(0.5F, 0.5F);
    normals.emplace_back(Eigen::Vector3f::Zero());
    for (int i = 0; i <= sides; ++i) {
      const double a = 2 * std::numbers::pi * i / sides * (end == 0 ? -1 : 1);
      vertices.emplace_back((centre + (e1 * std::cos(a) + e2 * std::sin(a)) * r).cast<float>());
      uvs.emplace_back(static_cast<float>(0.5 + 0.5 * std::cos(a)),
                       static_cast<float>(0.5 + 0.5 * std::sin(a)));
      normals.emplace_back(Eigen::Vector3f::Zero());
      if (i == 0) continue;
      const std::uint32_t k = start + static_cast<std::uint32_t>(i);
      triangles.push_back({start, k, k + 1});
      materials.push_back(static_cast<std::uint16_t>(cap_material < 0 ? material : cap_material));
    }
  }
}

void Mesh::ellipsoid(const Vec3& centre, const Vec3& radii, int rings, int sectors, int material,
                     double bump, std::uint64_t seed) {
  const auto base = static_cast<std::uint32_t>(vertices.size());
  for (int i = 0; i <= rings; ++i) {
    const double theta = std::numbers::pi * i / rings;
    for (int j = 0; j <= sectors; ++j) {
      const double phi = 2 * std::numbers::pi * j / sectors;
      const Vec3 n(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                   -std::cos(theta));
      const bool pole = i == 0 || i == rings;
      const double k =
          1 +
          bump * (static_cast<double>(hash_of(seed, static_cast<std::uint64_t>(i),
                                              static_cast<std::uint64_t>(pole ? 0 : j % sectors)) >>
                                      11) *
                      0x1.0p-52 -
                  1.0);
      vertices.emplace_back((centre + n.cwiseProduct(radii) * k).cast<float>());
      uvs.emplace_back(static_cast<float>(phi * std::max(radii.x(), radii.y())),
                       static_cast<float>(theta * radii.z()));
      normals.emplace_back(n.cwiseQuotient(radii).normalized().cast<float>());
    }
  }
  const auto stride = static_cast<std::uint32_t>(sectors + 1);
  for (int i = 0; i < rings; ++i) {
    for (int j = 0; j < sectors; ++j) {
      const std::uint32_t k = base + static_cast<std::uint32_t>(i) * stride + j;
      if (i > 0) {
        triangles.push_back({k, k + 1, k + stride + 1});
        materials.push_back(static_cast<std::uint16_t>(material));
      }
      if (i < rings - 1 || i == 0) {
        triangles.push_back({k, k + stride + 1, k + stride});
        materials.push_back(static_cast<std::uint16_t>(material));
      }
    }
  }
}

void Mesh::floor_polygon(const std::vector<Vec2>& corners, double z, int material) {
  const auto base = static_cast<std::uint32_t>(vertices.size());
  for (const Vec2& c : corners) {
    vertices.emplace_back(Vec3(c.x(), c.y(), z).cast<float>());
    uvs.emplace_back(c.cast<float>());
    normals.emplace_back(Eigen::Vector3f::Zero());
  }
  for (std::uint32_t i = 1; i + 1 < corners.size(); ++i) {
    triangles.push_back({base, base + i, base + i + 1});
    materials.push_back(static_cast<std::uint16_t>(material));
  }
}

void Mesh::append(const Mesh& other) {
  const auto base = static_cast<std::uint32_t>(vertices.size());
  vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
  uvs.insert(uvs.end(), other.uvs.begin(), other.uvs.end());
  normals.insert(normals.end(), other.normals.begin(), other.normals.end());
  for (const auto& t : other.triangles) {
    triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
  }
  materials.insert(materials.end(), other.materials.begin(), other.materials.end());
}

}  // namespace kys_slam::simulator
