// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "priors/fusion/fuse.h"

namespace kys_slam::synthetic {

inline StereoCamera kitti_camera(int width = 1241, int height = 376) {
  StereoCamera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 718.856 * width / 1241.0;
  camera.cx = 607.1928 * width / 1241.0;
  camera.cy = 185.2157 * height / 376.0;
  camera.baseline = 0.537;
  return camera;
}

/// A moving or parked box in front of the background.
struct Box {
  int x0, y0, x1, y1;     ///< px
  double depth;           ///< m
  Eigen::Vector3d shift;  ///< m, its own motion in the world between the frames, camera axes
};

/// A street canyon: road 1.65 m below the camera, walls 8 m to the sides, end wall at 120 m, and
/// boxes. Segments: 1 road, 2 building (stuff); boxes are things from 3 on. Flow is exact for a
/// camera that moves by T_next_now.
inline CameraPerception street(const StereoCamera& k, const Rigid3& T_next_now,
                               const std::vector<Box>& boxes) {
  CameraPerception p;
  p.panoptic.map = ImageOf<std::uint16_t>(k.width, k.height);
  p.disparity = ImageOf<float>(k.width, k.height);
  p.flow = FlowField{ImageOf<float>(k.width, k.height), ImageOf<float>(k.width, k.height)};
  p.panoptic.segments = {{0, 100, false}, {0, 101, false}};
  p.instances = {100, 101};
  for (std::size_t b = 0; b < boxes.size(); ++b) {
    p.panoptic.segments.push_back({static_cast<std::uint32_t>(b + 1), 2, true});
    p.instances.push_back(static_cast<std::int32_t>(65536 + b));
  }
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double x = (u - k.cx) / k.fx, y = (v - k.cy) / k.fy;
      double depth = 120;
      std::uint16_t segment = 2;
      if (std::abs(x) * depth > 8) depth = 8 / std::abs(x);
      if (y * depth > 1.65) {
        depth = 1.65 / y;
        segment = 1;
      }
      Eigen::Vector3d shift = Eigen::Vector3d::Zero();
      for (std::size_t b = 0; b < boxes.size(); ++b) {
        const Box& box = boxes[b];
        if (u < box.x0 || u >= box.x1 || v < box.y0 || v >= box.y1) continue;
        depth = box.depth;
        shift = box.shift;
        segment = static_cast<std::uint16_t>(3 + b);
      }
      const Eigen::Vector2d to =
          k.project(T_next_now * (k.back_project(u, v, depth) + shift).eval());
      p.panoptic.map.at(u, v) = segment;
      p.disparity.at(u, v) = static_cast<float>(k.bf() / depth);
      p.flow->u.at(u, v) = static_cast<float>(to.x() - u);
      p.flow->v.at(u, v) = static_cast<float>(to.y() - v);
    }
  }
  p.panoptic.runs = find_runs(p.panoptic.map);
  return p;
}

/// Far enough for every depth in here.
inline InverseDepth depth_of(const StereoCamera& k) {
  return {k.bf(), 255};
}

/// Inverse depths (1/m) of a row.
inline std::vector<float> inverse_depths(const StereoCamera& k, const CameraPerception& p, int y) {
  std::vector<float> row;
  for (int x = 0; x < k.width; ++x) row.push_back(depth_of(k)(p.disparity.at(x, y)));
  return row;
}

inline Rigid3 motion(double wx, double wy, double wz, double tx, double ty, double tz) {
  return {so3_exp({wx, wy, wz}), Eigen::Vector3d(tx, ty, tz)};
}

}  // namespace kys_slam::synthetic
