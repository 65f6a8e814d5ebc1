// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/boxes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNear = 1e-3;      // m, depth: what is nearer is not seen
constexpr double kPassed = 0.1;     // m: what is nearer is beside the camera
constexpr double kRounding = 1e-4;  // m, more than the float depth of a raster is off

// Whether the box can be in the image, where, and from which depth on.
bool find_outline(const StereoCamera& k, const Rigid3& T_c_o, SeenBox& box) {
  std::array<Vector3d, 8> corners;
  double farthest = -kInfinity;
  for (unsigned c = 0; c < 8; ++c) {
    const Vector3d sign(c & 1U ? 1 : -1, c & 2U ? 1 : -1, c & 4U ? 1 : -1);
    corners[c] = T_c_o * Vector3d(sign.cwiseProduct(box.half));
    farthest = std::max(farthest, corners[c].z());
  }
  if (farthest < kPassed) return false;
  box.u0 = box.v0 = kInfinity;
  box.u1 = box.v1 = -kInfinity;
  box.nearest = kInfinity;
  const auto cover = [&](const Vector3d& p) {
    const double u = k.fx * p.x() / p.z() + k.cx;
    const double v = k.fy * p.y() / p.z() + k.cy;
    box.u0 = std::min(box.u0, u);
    box.u1 = std::max(box.u1, u);
    box.v0 = std::min(box.v0, v);
    box.v1 = std::max(box.v1, v);
    box.nearest = std::min(box.nearest, p.z() - kRounding);
  };
  for (unsigned c = 0; c < 8; ++c) {
    if (corners[c].z() >= kNear) cover(corners[c]);
    // The edges from this corner that pass the plane of the nearest depth.
    for (unsigned axis = 1; axis < 8; axis *= 2) {
      const Vector3d& a = corners[c];
      const Vector3d& b = corners[c | axis];
      if ((a.z() < kNear) == (b.z() < kNear)) continue;
      cover(a + (kNear - a.z()) / (b.z() - a.z()) * (b - a));
    }
  }
  box.reaches_past = box.nearest < kPassed;
  // The last blocks of a raster end behind the border of the image.
  const double border = box.reaches_past ? BoxRaster::kBlock : 0;
  if (box.u1 < 0 || box.v1 < 0 || box.u0 >= k.width + border || box.v0 >= k.height + border) {
    return false;
  }
  if (box.reaches_past) {
    box.u0 = std::max(box.u0, 0.0);
    box.v0 = std::max(box.v0, 0.0);
    box.u1 = std::min<double>(box.u1, k.width);
    box.v1 = std::min<double>(box.v1, k.height);
  }
  return true;
}

}  // namespace

double depth_of_hit(const SeenBox& box, const Vector3d& ray) {
  const Vector3d from = box.T_o_c.t();
  const Vector3d way = box.T_o_c.rotation * ray;
  double enter = 0, leave = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    const double h = box.half[axis];
    if (std::abs(way[axis]) < 1e-12) {
      if (std::abs(from[axis]) > h) return kInfinity;
      continue;
    }
    const double a = (-h - from[axis]) / way[axis];
    const double b = (h - from[axis]) / way[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave ? enter : kInfinity;
}

std::vector<SeenBox> boxes_in_view(const StereoCamera& camera, const Rigid3& T_c_w,
                                   std::span<const std::int32_t> objects,
                                   std::span<const Rigid3> T_w_o, std::span<const Vector3d> half) {
  std::vector<SeenBox> boxes;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    SeenBox box;
    box.object = objects[i];
    box.half = half[i];
    const Rigid3 T_c_o = T_c_w * T_w_o[i];
    box.T_o_c = T_c_o.inverse();
    if (find_outline(camera, T_c_o, box)) boxes.push_back(box);
  }
  return boxes;
}

BoxRaster::BoxRaster(const StereoCamera& camera, std::span<const SeenBox> boxes)
    : columns_((camera.width + kBlock - 1) / kBlock), rows_((camera.height + kBlock - 1) / kBlock) {
  const auto count = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  object_.assign(count, -1);
  depth_.assign(count, std::numeric_limits<float>::infinity());
  // The nearest box first: those behind it are not tested where it covers them.
  std::vector<const SeenBox*> order;
  for (const SeenBox& box : boxes) order.push_back(&box);
  std::ranges::stable_sort(order, {}, &SeenBox::nearest);
  const auto block = [](double px, int end) {
    return std::clamp(static_cast<int>(std::floor(px / kBlock)), 0, end - 1);
  };
  for (const SeenBox* b : order) {
    const SeenBox& box = *b;
    const int x1 = block(box.u1, columns_);
    const int y1 = block(box.v1, rows_);
    for (int y = block(box.v0, rows_); y <= y1; ++y) {
      for (int x = block(box.u0, columns_); x <= x1; ++x) {
        const auto at = static_cast<std::size_t>(y * columns_ + x);
        if (box.nearest > depth_[at]) continue;
        const Eigen::Vector3d ray(((x + 0.5) * kBlock - camera.cx) / camera.fx,
                                  ((y + 0.5) * kBlock - camera.cy) / camera.fy, 1);
        const auto depth = static_cast<float>(depth_of_hit(box, ray));
        // At the same depth the lower object, in whatever order they come.
        if (depth > depth_[at] || (depth == depth_[at] && box.object > object_[at])) continue;
        depth_[at] = depth;
        object_[at] = box.object;
      }
    }
  }
}

}  // namespace kys_slam::simulator
