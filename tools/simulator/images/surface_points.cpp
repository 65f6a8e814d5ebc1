// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/surface_points.h"

#include <fmt/format.h>
#include <kys/prior.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <vector>

#include "simulator/common/rng.h"
#include "simulator/images/ray_kernel.h"

namespace kys_slam::simulator {
namespace {

constexpr double kReach = 60;              // m, from which a surface counts as seen
constexpr std::size_t kMostViews = 20;     // frames in whose views points are tested
constexpr double kBefore = 0.01;           // m, by which a ray ends before the surface
constexpr std::int64_t kMostDraws = 2000;  // per point wanted

struct Triangle {
  Eigen::Vector3d a, ab, ac;  // world frame
  int category = 0;
};

struct SurfacePoint {
  Eigen::Vector3d p_w;
  Eigen::Vector3d normal;
  int category = 0;
  bool seen = false;
};

/// Triangles of static instances near the path, and the sums of their areas.
class Surfaces {
 public:
  explicit Surfaces(const World& world) {
    for (const Instance& instance : world.scene.instances) {
      if (instance.motion) continue;
      const Mesh& mesh = world.scene.prototypes[static_cast<std::size_t>(instance.prototype)];
      const int category = world.scene.objects[static_cast<std::size_t>(instance.object)].category;
      for (const auto& t : mesh.triangles) {
        const auto at = [&](std::size_t k) -> Eigen::Vector3d {
          return instance.T_w_o * (instance.scale * mesh.vertices[t.at(k)].cast<double>());
        };
        const Eigen::Vector3d a = at(0);
        add({a, at(1) - a, at(2) - a, category}, world);
      }
    }
  }
  [[nodiscard]] bool empty() const { return triangles_.empty(); }

  [[nodiscard]] SurfacePoint draw(Rng& rng) const {
    const double at = rng.uniform() * sums_.back();
    const auto found = std::upper_bound(sums_.begin(), sums_.end() - 1, at);
    const Triangle& t = triangles_[static_cast<std::size_t>(found - sums_.begin())];
    double s = rng.uniform();
    double r = rng.uniform();
    if (s + r > 1) s = 1 - s, r = 1 - r;
    return {t.a + s * t.ab + r * t.ac, t.ab.cross(t.ac).normalized(), t.category};
  }

 private:
  void add(const Triangle& t, const World& world) {
    const double area = t.ab.cross(t.ac).norm() / 2;
    if (!(area > 0)) return;
    const double reach = kReach + std::max(t.ab.norm(), t.ac.norm());
    const bool near = std::any_of(world.T_w_c.begin(), world.T_w_c.end(),
                                  [&](const Rigid3& T) { return (T.t() - t.a).norm() < reach; });
    if (!near) return;
    triangles_.push_back(t);
    sums_.push_back((sums_.empty() ? 0 : sums_.back()) + area);
  }

  std::vector<Triangle> triangles_;
  std::vector<double> sums_;
};

/// Tests points against the views of all frames.
class Views {
 public:
  explicit Views(const World& world)
      : world_(world), meshes_(world.scene), rays_(meshes_, world.scene) {}

  void mark_seen(std::vector<SurfacePoint>& points) {
    const std::size_t every = 1 + (world_.times.size() - 1) / kMostViews;
    for (std::size_t frame = 0; frame < world_.times.size(); frame += every) {
      rays_.set_time(world_.times[frame]);
      const Rigid3& T_w_c = world_.T_w_truth[frame];
      const Rigid3 T_c_w = T_w_c.inverse();
      std::vector<SurfacePoint*> in_view;
      for (SurfacePoint& p : points) {
        if (!p.seen && faces(p, T_w_c, T_c_w)) in_view.push_back(&p);
      }
      for (std::size_t k = 0; k < in_view.size(); k += kPacket) {
        cast({in_view.begin() + static_cast<std::ptrdiff_t>(k),
              in_view.begin() + static_cast<std::ptrdiff_t>(std::min(in_view.size(), k + kPacket))},
             T_w_c);
      }
    }
  }

 private:
  [[nodiscard]] bool faces(const SurfacePoint& p, const Rigid3& T_w_c, const Rigid3& T_c_w) const {
    const Eigen::Vector3d p_c = T_c_w * p.p_w;
    if (p_c.z() < 0.1 || p_c.norm() > kReach) return false;
    if (p.normal.dot(T_w_c.t() - p.p_w) <= 0) return false;
    const Eigen::Vector2d pixel = world_.rectified.project(p_c);
    return world_.rectified.in_image(pixel.x(), pixel.y());
  }

  void cast(const std::vector<SurfacePoint*>& points, const Rigid3& T_w_c) {
    RayPacket rays{};
    rays.active.fill(false);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Eigen::Vector3d to = points[k]->p_w - T_w_c.t();
      const double distance = to.norm();
      const Eigen::Vector3f o = T_w_c.t().cast<float>();
      const Eigen::Vector3f d = (to / distance).cast<float>();
      rays.ox[k] = o.x(), rays.oy[k] = o.y(), rays.oz[k] = o.z();
      rays.dx[k] = d.x(), rays.dy[k] = d.y(), rays.dz[k] = d.z();
      rays.t[k] = static_cast<float>(distance - kBefore);
      rays.active[k] = true;
    }
    std::array<bool, kPacket> blocked{};
    rays_.occluded(rays, blocked);
    for (std::size_t k = 0; k < points.size(); ++k) points[k]->seen = !blocked[k];
  }

  const World& world_;
  RayMeshes meshes_;
  RayScene rays_;
};

template <typename T>
void append_bytes(std::string& text, T value) {
  const auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  text.append(bytes.data(), bytes.size());
}

std::string to_ply(const std::vector<SurfacePoint>& points, const Rigid3& T_truth_w) {
  std::map<int, int> classes;  // dense index, category
  for (const SurfacePoint& p : points) {
    if (const auto label = coco_label(p.category); label != kys::kVoidLabel) {
      classes[label] = p.category;
    }
  }
  std::string text =
      "ply\nformat binary_little_endian 1.0\n"
      "comment points on static surfaces, m, frame of the ground truth; class -1: none\n";
  text += fmt::format("comment label_space {}\n", kFeatureLabelSpace);
  for (const auto& [label, category] : classes) {
    text += fmt::format("comment class {} {}\n", label, coco_name(category));
  }
  text += fmt::format(
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nproperty int class\nend_header\n",
      points.size());
  for (const SurfacePoint& p : points) {
    const Eigen::Vector3f at = (T_truth_w * p.p_w).cast<float>();
    const Eigen::Vector3f normal = (T_truth_w.R() * p.normal).cast<float>();
    for (int c = 0; c < 3; ++c) append_bytes(text, at[c]);
    for (int c = 0; c < 3; ++c) append_bytes(text, normal[c]);
    const std::uint16_t label = coco_label(p.category);
    append_bytes<std::int32_t>(text, label == kys::kVoidLabel ? -1 : label);
  }
  return text;
}

}  // namespace

std::string surface_ply(const World& world, std::int64_t count, std::uint64_t seed) {
  const Surfaces surfaces(world);
  Views views(world);
  Rng rng(hash_of(seed, 41));
  std::vector<SurfacePoint> seen;
  std::int64_t draws = 0;
  while (static_cast<std::int64_t>(seen.size()) < count) {
    if (surfaces.empty() || draws >= kMostDraws * count) {
      throw InputError(fmt::format("--surface-points {}: the cameras see too few surfaces", count));
    }
    std::vector<SurfacePoint> drawn;
    for (std::int64_t k = 0; k < 4 * count; ++k) drawn.push_back(surfaces.draw(rng));
    draws += 4 * count;
    views.mark_seen(drawn);
    for (const SurfacePoint& p : drawn) {
      if (p.seen && static_cast<std::int64_t>(seen.size()) < count) seen.push_back(p);
    }
  }
  const bool kitti = world.layout == Layout::kKitti;
  return to_ply(seen, kitti ? world.T_w_c.front().inverse() : Rigid3());
}

}  // namespace kys_slam::simulator
