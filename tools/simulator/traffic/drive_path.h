// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>

#include <vector>

namespace kys_slam::simulator {

inline constexpr double kLeftLane = -3.4;  ///< m, to the right of the own lane's middle

/// The path of a camera, smoothed, parametrised by path length and extended straight beyond its two
/// ends. Frames on it are those of the camera: x right, y down, z forward.
class DrivePath {
 public:
  explicit DrivePath(const std::vector<TimedPose>& poses);

  [[nodiscard]] double length() const { return length_; }  ///< m
  [[nodiscard]] Rigid3 at(double s) const;                 ///< T_w_p after s metres
  /// T_w_o of something that is at t (m) in the path's frame after s metres, turned by yaw (rad).
  [[nodiscard]] Rigid3 beside(double s, const Eigen::Vector3d& t, double yaw) const;
  /// Path length (m) at a time (s), smoothed; extrapolated with the last speed beyond the ends.
  [[nodiscard]] double path_length_at(double time) const;
  [[nodiscard]] double speed_at(double time) const;  ///< m/s, mean over the second around the time
  /// Change of heading between two path lengths, rad.
  [[nodiscard]] double turn_between(double s0, double s1) const;
  [[nodiscard]] double first_time() const { return times_.front(); }
  [[nodiscard]] double last_time() const { return times_.back(); }

 private:
  double length_ = 0;
  std::vector<Rigid3> samples_;  ///< every kStep metres
  std::vector<double> times_, path_lengths_;
};

}  // namespace kys_slam::simulator
