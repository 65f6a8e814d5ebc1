// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "features/kernels.h"

namespace kys_slam {

/// Grey image pyramid: level l is the input reduced by scale_factor^l (bilinear), not blurred. A
/// level below one pixel is empty.
struct ImagePyramid {
  std::vector<GrayImage> levels;

  /// Pixel of a level from a pixel of the full image, and back. All levels have the same field of
  /// view: the corners of the images coincide, not the centres of their first pixels.
  [[nodiscard]] Eigen::Vector2f to_level(std::size_t octave, float x, float y) const;
  [[nodiscard]] Eigen::Vector2f to_full(std::size_t octave, float x, float y) const;
};

/// Reduces images by bilinear interpolation (pixel areas aligned, edges repeated) in fixed point,
/// within one grey level of the exact value. Keeps its tables between calls with the same sizes.
class Reducer {
 public:
  /// Fills `to`, whose size is set by the caller, from `from`.
  void reduce(const GrayImage& from, GrayImage& to);

 private:
  void plan(int from_width, int to_width);

  int from_width_ = 0;
  int to_width_ = 0;
  std::vector<std::int32_t> first_;
  std::vector<kernels::ResizeGroup> groups_;
  std::vector<std::int16_t> rows_[2];
};

/// Builds a pyramid of `levels` levels, each from the one before; level sizes are those of the
/// input divided by scale_factor^l, rounded.
class PyramidBuilder {
 public:
  void build(const GrayImage& image, double scale_factor, int levels, ImagePyramid& pyramid);

 private:
  std::vector<Reducer> reducers_;
};

}  // namespace kys_slam
