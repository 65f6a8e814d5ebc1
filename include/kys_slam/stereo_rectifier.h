#pragma once

#include <kys_slam/image.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace kys_slam {

/// How a lens bends rays.
enum class LensModel : std::uint8_t {
  kRadialTangential,  ///< Brown-Conrady: k1 k2 p1 p2 [k3 [k4 k5 k6]], as OpenCV's pinhole model
  kEquidistant,       ///< Kannala-Brandt: k1 k2 k3 k4, as OpenCV's fisheye model
};

/// A raw camera of a rig: pinhole with distortion.
struct RawCamera {
  int width = 0;                          ///< px
  int height = 0;                         ///< px
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< px
  std::vector<double> distortion;         ///< coefficients of the lens model; empty: none
  Rigid3 T_b_s;                           ///< camera (sensor) to body
  LensModel lens = LensModel::kRadialTangential;
};

/// Turns raw images of two cameras into a rectified pair of the same size, with maps computed once.
/// Bouguet's rectification with equal principal points, scaled until every pixel of the result
/// comes from inside the raw images (zoom "alpha" 0: what published EuRoC settings use, fx 435.2).
/// Equidistant lenses: the same rotations, the principal point in the middle of the image, the
/// smallest focal length at which the border comes from inside both raw images. Thread-safe once
/// made.
class StereoRectifier {
 public:
  /// \param name  named in messages (the sequence)
  /// \throws InputError when the rig cannot be rectified (non-finite or absurd numbers, cameras of
  ///   different size or lens model, right camera not to the right of the left one).
  StereoRectifier(const RawCamera& left, const RawCamera& right, const std::string& name);
  StereoRectifier(StereoRectifier&&) noexcept;
  StereoRectifier& operator=(StereoRectifier&&) noexcept;
  ~StereoRectifier();

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }
  /// Rectified left camera to body.
  [[nodiscard]] const Rigid3& T_b_c() const { return T_b_c_; }

  /// Bilinear, positions rounded to 1/32 px. \throws InputError when `raw` has another size than
  /// the raw cameras.
  [[nodiscard]] GrayImage rectify_left(const GrayImage& raw) const;
  [[nodiscard]] GrayImage rectify_right(const GrayImage& raw) const;

 private:
  struct Maps;
  void rectify_equidistant(const RawCamera& left, const RawCamera& right, const std::string& name);

  StereoCamera camera_;
  Rigid3 T_b_c_;
  std::array<std::unique_ptr<Maps>, 2> maps_;
};

}  // namespace kys_slam
