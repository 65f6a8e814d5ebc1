// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// What a camera sees that drives along a wall: images of known geometry, for the programs here.
#include <kys_slam/image.h>
#include <kys_slam/sequence.h>
#include <kys_slam/stereo_camera.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace wall {

inline constexpr int kFrames = 8;
inline const kys_slam::StereoCamera kCamera{320, 240, 250, 250, 159.5, 119.5, 0.2};

inline Eigen::Vector3d position(int i) {
  return {0.05 * i, 0, 0.1 * i};
}

/// Grey value of the wall at z = 6 m and the floor below: blocks of several sizes.
inline double grey(double s, double t) {
  double value = 128;
  for (double size = 0.05; size < 1; size *= 2) {
    auto h = static_cast<std::uint64_t>(std::llround(std::floor(s / size)) * 1000003 +
                                        std::llround(std::floor(t / size)) * 7919 + size * 640);
    h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ull;
    h = (h ^ (h >> 27)) * 0x94D049BB133111EBull;
    value += 50 * (static_cast<double>(h >> 40) / (1 << 24) - 0.5);
  }
  return value;
}

inline double look(const Eigen::Vector3d& from, const Eigen::Vector3d& ray) {
  const double to_wall = (6 - from.z()) / ray.z();
  const double to_floor = ray.y() > 0 ? (1 - from.y()) / ray.y() : to_wall;
  const Eigen::Vector3d p = from + std::min(to_wall, to_floor) * ray;
  return to_floor < to_wall ? grey(p.x(), p.z() + 50) : grey(p.x(), p.y() - 50);
}

inline kys_slam::GrayImage take_picture(const Eigen::Vector3d& from) {
  kys_slam::GrayImage image(kCamera.width, kCamera.height);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      double value = 0;
      for (int k = 0; k < 9; ++k) {  // a pixel sees an area, not a point
        value += look(from, kCamera.back_project(x + (k % 3 - 1) / 3.0, y + (k / 3 - 1) / 3.0, 1));
      }
      image.at(x, y) = static_cast<std::uint8_t>(std::clamp(std::lround(value / 9), 0L, 255L));
    }
  }
  return image;
}

inline kys_slam::StereoFrame grab(int i) {
  kys_slam::StereoFrame frame;
  frame.index = i;
  frame.timestamp = 0.1 * i;
  frame.left = take_picture(position(i));
  frame.right = take_picture(position(i) + Eigen::Vector3d(kCamera.baseline, 0, 0));
  return frame;
}

}  // namespace wall
