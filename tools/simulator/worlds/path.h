// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <functional>
#include <vector>

#include "simulator/shapes/mesh.h"

namespace kys_slam::simulator {

/// A smooth line on the ground, by arc length (m): straight parts joined by turns with linearly
/// rising and falling curvature, as of a steered car. Extended straight beyond both ends.
class Path {
 public:
  /// Corner points, and the smallest radius (m) of the turns.
  Path(const std::vector<Vec2>& corners, double radius);
  /// The path shifted to its left by `offset` m (for small offsets; arc length is the original's).
  [[nodiscard]] Vec2 position(double s, double offset = 0) const;
  /// rad, anticlockwise from +x; continuous.
  [[nodiscard]] double heading(double s) const;
  [[nodiscard]] double curvature(double s) const;  ///< 1/m, positive to the left
  [[nodiscard]] double length() const { return length_; }

 private:
  struct Sample {
    Vec2 p;
    double heading;
  };
  [[nodiscard]] Sample at(double s) const;
  std::vector<Sample> samples_;  ///< every kStep metres
  double length_ = 0;
};

/// Arc length over time: integrates a speed that depends on position and time.
class Drive {
 public:
  /// speed(s, t) in m/s.
  Drive(double start, double duration, const std::function<double(double, double)>& speed);
  /// Before 0 as if the first speed had been driven.
  [[nodiscard]] double distance(double t) const;

 private:
  std::vector<double> s_;  ///< every kTick seconds
};

/// Rises smoothly from 0 at a to 1 at b.
double smooth_step(double a, double b, double x);

/// T_w_c of a left camera on a vehicle whose ground point follows the path: it faces along the
/// heading, `height` (m) above the ground, with small heave, pitch and roll.
Rigid3 car_camera(const Path& path, double s, double t, double height);

/// Rotation of a camera (x right, y down, z forward) in a vehicle (x forward, y left, z up).
Eigen::Matrix3d vehicle_from_camera();

}  // namespace kys_slam::simulator
