#pragma once

#include <kys_slam/frame_source.h>

#include <vector>

namespace kys_slam::simulator {

/// A camera's way by its length: where it is after so many metres, smoothed, and carried on
/// straight ahead beyond its two ends. Object frames on it are as the camera's: x right, y down, z
/// forward.
class DrivePath {
 public:
  explicit DrivePath(const std::vector<TimedPose>& poses);

  [[nodiscard]] double length() const { return length_; }  ///< m
  [[nodiscard]] Rigid3 at(double s) const;                 ///< T_w_p after s metres
  /// Metres done at a time (s), smoothed; carried on at the last speed beyond the ends.
  [[nodiscard]] double way_at(double time) const;
  [[nodiscard]] double speed_at(double time) const;  ///< m/s, of the second around the time
  /// Change of heading between two places, rad.
  [[nodiscard]] double turn_between(double s0, double s1) const;
  [[nodiscard]] double first_time() const { return times_.front(); }
  [[nodiscard]] double last_time() const { return times_.back(); }

 private:
  double length_ = 0;
  std::vector<Rigid3> samples_;  ///< every kStep metres
  std::vector<double> times_, way_;
};

}  // namespace kys_slam::simulator
