// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <span>
#include <vector>

namespace kys_slam::simulator {

/// A solid box in front of a camera.
struct SeenBox {
  std::int32_t object = 0;
  Rigid3 T_o_c;               ///< camera frame to the box's own axes
  Eigen::Vector3d half;       ///< m
  double nearest = 0;         ///< m, no part in front of the camera has a smaller depth
  bool reaches_past = false;  ///< begins beside the camera or behind it
  // Of its image: everything it covers lies within (px). Cut at the image for a box that reaches
  // past the camera.
  double u0 = 0, v0 = 0, u1 = 0, v1 = 0;
};

/// Depth (m) at which `ray` (camera frame, z = 1) meets the box; infinity: it misses; 0: it starts
/// inside.
double depth_of_hit(const SeenBox& box, const Eigen::Vector3d& ray);

/// The boxes in the view of one camera.
/// \param T_c_w  of that camera
std::vector<SeenBox> boxes_in_view(const StereoCamera& camera, const Rigid3& T_c_w,
                                   std::span<const std::int32_t> objects,
                                   std::span<const Rigid3> T_w_o,
                                   std::span<const Eigen::Vector3d> half);

/// The nearest box and its depth, per block of pixels.
class BoxRaster {
 public:
  static constexpr int kBlock = 4;  ///< px

  BoxRaster(const StereoCamera& camera, std::span<const SeenBox> boxes);

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  /// Object at a pixel; -1: none, or outside the image.
  [[nodiscard]] std::int32_t object_at(double u, double v) const {
    const int at = index(u, v);
    return at < 0 ? -1 : object_[static_cast<std::size_t>(at)];
  }
  /// Depth of its surface, m; 0 outside the image.
  [[nodiscard]] float depth_at(double u, double v) const {
    const int at = index(u, v);
    return at < 0 ? 0 : depth_[static_cast<std::size_t>(at)];
  }
  [[nodiscard]] const std::vector<std::int32_t>& objects() const { return object_; }
  [[nodiscard]] const std::vector<float>& depths() const { return depth_; }

 private:
  [[nodiscard]] int index(double u, double v) const {
    const int x = static_cast<int>(u) / kBlock;
    const int y = static_cast<int>(v) / kBlock;
    return u < 0 || v < 0 || x >= columns_ || y >= rows_ ? -1 : y * columns_ + x;
  }

  int columns_ = 0, rows_ = 0;
  std::vector<std::int32_t> object_;
  std::vector<float> depth_;
};

/// The boxes of a frame in the views of the two cameras.
struct FrameScene {
  std::vector<SeenBox> left, right;
  BoxRaster left_raster, right_raster;
  float mover_share = 0;  ///< share of the left image covered by objects that can move
};

}  // namespace kys_slam::simulator
