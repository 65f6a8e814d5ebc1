// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

namespace kys_slam {

/// How the two cameras differ from a given calibration. All are zero for a perfect calibration.
enum class RigParameter : std::uint8_t {
  kLeftK1,   ///< radial distortion left in the left images, of r^2
  kLeftK2,   ///< the same, of r^4
  kLeftP1,   ///< tangential distortion left in them
  kLeftP2,   ///<
  kRightK1,  ///< the same of the right images
  kRightK2,  ///<
  kRightP1,  ///<
  kRightP2,  ///<
  kYaw,      ///< rad, the right camera about its y axis, with its principal point moved along
  kPitch,    ///< rad, about its x axis, likewise
  kRoll,     ///< rad, about its z axis
  kRatio,    ///< focal length of the right camera over that of the left one, less 1
  kOffset,   ///< px, to be added to every disparity: principal points and yaw
  kRow,      ///< px, rows of the right image less rows of the left one: principal points and pitch
  kBaselineY,  ///< the right camera is this part of the baseline too low
  kBaselineZ,  ///< the right camera is this part of the baseline in front
  kFocal,      ///< true focal length of both over the given one, less 1; fx * baseline is as given
};

/// Correction of what two cameras measure to what the given rectified pair would have measured:
/// equal intrinsics, no distortion, parallel axes, the right camera along +x. Each parameter adds a
/// displacement that is a polynomial of the measured position. With normalised coordinates x = (u -
/// cx) / (fx (1 + focal)), y likewise, r^2 = x^2 + y^2, measured positions are corrected by
///
///     -k1 r^2 (x, y) - k2 r^4 (x, y) - p1 (2 x y, r^2 + 2 y^2) - p2 (r^2 + 2 x^2, 2 x y)
///
/// in both images, and in the right one also by
///
///     yaw (x^2, x y) - pitch (x y, y^2) + roll (-y, x) - ratio (x, y) - (offset / fx, row / fy).
///
/// These are Brown's lens model and a rotation, of first order in the parameters. Then the depth
/// follows from both rays, the right camera being at baseline (1, baseline_y, baseline_z), and from
/// it the column in the right image of the perfect pair. Pixels are of full resolution.
class RigCorrection {
 public:
  static constexpr int kSize = static_cast<int>(RigParameter::kFocal) + 1;
  using Parameters = Eigen::Matrix<double, kSize, 1>;
  using Covariance = Eigen::Matrix<double, kSize, kSize>;

  RigCorrection() = default;
  RigCorrection(const StereoCamera& given, const Parameters& parameters);
  /// The constant offset (px) of all disparities alone.
  static RigCorrection of_offset(const StereoCamera& given, double offset);

  [[nodiscard]] const Parameters& parameters() const { return parameters_; }
  [[nodiscard]] double operator[](RigParameter p) const { return parameters_[static_cast<int>(p)]; }
  [[nodiscard]] double offset() const { return (*this)[RigParameter::kOffset]; }
  /// No correction at all.
  [[nodiscard]] bool none() const { return !bends_ && offset() == 0; }
  /// Whether anything but the offset is not zero: positions and rows change.
  [[nodiscard]] bool bends() const { return bends_; }

  /// What is measured: px of the images as given.
  struct Measured {
    float u = 0;
    float v = 0;
    float u_right = std::numeric_limits<float>::quiet_NaN();  ///< NaN: no match
    float v_right = std::numeric_limits<float>::quiet_NaN();  ///< NaN: not measured
    friend bool operator==(const Measured&, const Measured&) = default;
  };
  /// The same in the images of the perfect pair.
  struct Ideal {
    double u = 0, v = 0, u_right = 0;
    double row = 0;  ///< px, right row less left row that is not explained
  };
  /// Position in the perfect left image of a position in the given one.
  [[nodiscard]] Eigen::Vector2d left(double u, double v) const;
  /// Position in the right image, of a point at infinity in the direction that it shows.
  [[nodiscard]] Eigen::Vector2d right(double u, double v) const;
  /// Without a measured row the one at which the point is expected is used.
  [[nodiscard]] Ideal pair(const Measured& m) const;

  /// The other way: position in the given left image.
  [[nodiscard]] Eigen::Vector2d measured_left(double u, double v) const;
  /// Position in the given right image of what the perfect pair has at (u, v) and (u_right, v).
  [[nodiscard]] Eigen::Vector2d measured_right(double u, double v, double u_right) const;

  /// How much larger an interval is in the perfect left image than in the given one, along rows and
  /// across.
  [[nodiscard]] Eigen::Vector2d stretch(double u, double v) const;
  [[nodiscard]] double focal_scale() const { return scale_; }

  /// Derivatives by the parameters of a measured pair's (u, v, disparity, row), px.
  using Jacobian = Eigen::Matrix<double, 4, kSize>;
  [[nodiscard]] Jacobian jacobian(const Measured& m) const;

  friend bool operator==(const RigCorrection& a, const RigCorrection& b) {
    return a.parameters_ == b.parameters_;
  }

 private:
  [[nodiscard]] Eigen::Vector2d normalised(double u, double v) const;
  [[nodiscard]] Eigen::Vector2d pixel(const Eigen::Vector2d& ray, double scale) const;
  [[nodiscard]] Eigen::Vector2d left_ray(const Eigen::Vector2d& measured) const;
  [[nodiscard]] Eigen::Vector2d right_ray(const Eigen::Vector2d& measured) const;
  /// b / Z of two rays.
  [[nodiscard]] double inverse_depth(double x_left, double x_right) const;

  StereoCamera given_;
  Parameters parameters_ = Parameters::Zero();
  bool bends_ = false;
  double scale_ = 1;  // 1 + focal
};

/// Name in files and messages, e.g. "left_k1", and unit, "" for none.
struct RigParameterName {
  std::string_view name;
  std::string_view unit;
};
const std::array<RigParameterName, RigCorrection::kSize>& rig_parameter_names();

/// An estimate of the offset of disparities alone, px, to be added to every disparity.
struct OffsetEstimate {
  double value = 0;
  double sigma = 0;      ///< with the systematic part
  bool applied = false;  ///< it is what disparities are corrected by
};

/// A correction and how well it is known.
struct RigEstimate {
  RigCorrection correction;
  RigCorrection::Covariance covariance = RigCorrection::Covariance::Zero();

  RigEstimate() = default;
  RigEstimate(const RigCorrection& known) : correction(known) {}
  RigEstimate(const RigCorrection& mean, const RigCorrection::Covariance& around)
      : correction(mean), covariance(around) {}

  /// Standard deviations (px) of (u, v, disparity, row) by the covariance, at a place.
  [[nodiscard]] Eigen::Vector4d sigma(const RigCorrection::Measured& m) const;
};

}  // namespace kys_slam
