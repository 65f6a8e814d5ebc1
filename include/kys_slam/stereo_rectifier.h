// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/rig_correction.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace kys_slam {

/// Distortion model of a lens.
enum class LensModel : std::uint8_t {
  kRadialTangential,  ///< Brown-Conrady: k1 k2 p1 p2 [k3 [k4 k5 k6]], as OpenCV's pinhole model
  kEquidistant,       ///< Kannala-Brandt: k1 k2 k3 k4, as OpenCV's fisheye model
};

/// A camera of a rig before rectification: pinhole with distortion.
struct RawCamera {
  int width = 0;                          ///< px
  int height = 0;                         ///< px
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< px
  std::vector<double> distortion;         ///< coefficients of the lens model; empty: none
  Rigid3 T_b_s;                           ///< camera (sensor) to body
  LensModel lens = LensModel::kRadialTangential;
};

/// Rectifies the raw images of two cameras to a pair of the same size, with maps computed once.
/// Radial-tangential lenses: Bouguet's rectification with equal principal points, scaled until
/// every pixel of the result lies inside the raw images (OpenCV's alpha 0, as in published EuRoC
/// settings, fx 435.2). Equidistant lenses: the same rotations, the principal point in the centre
/// of the image, the smallest focal length at which the border lies inside both raw images.
/// Thread-safe after construction.
class StereoRectifier {
 public:
  /// \param name of the sequence, for messages \throws InputError when the rig cannot be rectified:
  /// non-finite or implausible numbers, cameras of different size or lens model, right camera not
  /// to the right of the left one.
  StereoRectifier(const RawCamera& left, const RawCamera& right, const std::string& name);
  /// Of images that were rectified by a calibration which has a correction: the pair that results
  /// has the given intrinsics and no such error. It is turned such that the baseline is along x,
  /// and the baseline is that of the corrected rig. \param name for messages \throws InputError
  /// when the correction folds the images
  StereoRectifier(const StereoCamera& given, const RigCorrection& correction,
                  const std::string& name);
  StereoRectifier(StereoRectifier&&) noexcept;
  StereoRectifier& operator=(StereoRectifier&&) noexcept;
  ~StereoRectifier();

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }
  /// Rectified left camera to body.
  [[nodiscard]] const Rigid3& T_b_c() const { return T_b_c_; }

  /// Bilinear interpolation, positions rounded to 1/32 px. \throws InputError when the size of
  /// `raw` differs from that of the raw cameras.
  [[nodiscard]] GrayImage rectify_left(const GrayImage& raw) const;
  [[nodiscard]] GrayImage rectify_right(const GrayImage& raw) const;
  /// A map of numbers of the raw left image: those of the nearest pixels. \throws InputError as
  /// above
  [[nodiscard]] ImageOf<std::uint16_t> rectify_left_map(const ImageOf<std::uint16_t>& raw) const;

 private:
  struct Maps;

  StereoCamera camera_;
  Rigid3 T_b_c_;
  std::array<std::unique_ptr<Maps>, 2> maps_;
};

}  // namespace kys_slam
