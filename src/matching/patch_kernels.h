// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

/// The inner loops of patch alignment (patch_alignment.h, landmark_patch.h), compiled once per
/// instruction set from patch_kernels.inc. Every variant gives the same bytes; kernels() returns
/// the fastest one for this machine.
namespace kys_slam::patch {

inline constexpr int kHalf = 5;  ///< px
inline constexpr int kSide = 2 * kHalf + 1;
inline constexpr int kRow = 16;    ///< columns processed together; the last ones have weight 0
inline constexpr int kStrip = 32;  ///< columns of the right image
inline constexpr int kReach = 15;  ///< columns before the start column of the alignment
inline constexpr int kSlide = 5;   ///< px to either side, of the search in whole pixels

/// One patch of the left image at its sub-pixel position, and the same rows of the right image.
struct Pair {
  alignas(64) float wanted[kSide][kRow];
  alignas(64) float gradient[kSide][kRow];  ///< grey levels per px, along the row
  alignas(64) float strip[kSide][kStrip];
};

/// Weights by distance from the centre and offsets from it, px.
struct Window {
  alignas(64) float weight[kSide][kRow];
  alignas(64) float dx[kRow];
  float total;  ///< of the weights
};

/// Source pixels of a pair: rows r and r + 1 of either image give row r.
struct Source {
  const std::uint8_t* left;  ///< first row, one column before the patch
  std::ptrdiff_t left_stride;
  int left_columns;           ///< that may be read from there, at least 14
  const std::uint8_t* right;  ///< first row, first column of the image
  std::ptrdiff_t right_stride;
  int right_columns;  ///< of the image
  int first;          ///< first column of the strip; columns outside the image repeat the border
  float fraction_x;   ///< px, of the left patch, 0..1
  float fraction_y;   ///< px, of the left patch
  float right_fraction_y;  ///< px, of the right rows
};

/// Position of the patch in the strip: pixel (dx, dy) is in column middle + dx stretch + dy shear.
struct Place {
  float middle;
  float stretch;
  float shear;
};

/// Sums over the patch of weight w, gradient g, difference e (right minus left, mean removed), with
/// the vector a = g (1, dx, dy).
struct Sums {
  float square;  ///< grey levels squared, mean of e^2 by the window's weights
  float w, we;
  float a[3];   ///< w a
  float aa[6];  ///< w a a^T: 00, 10, 11, 20, 21, 22
  float ae[3];  ///< w a e
};

inline constexpr int kCornerHalf = 4;  ///< px, half side of the compared part of a landmark's patch
inline constexpr int kCornerSide = 2 * kCornerHalf + 1;
inline constexpr int kPatchReach = 8;  ///< px, half side of the stored patch
inline constexpr int kPatchSide = 2 * kPatchReach + 1;
/// Bytes of a stored patch: its pixels by rows, and three that are read with the last.
inline constexpr int kPatchBytes = kPatchSide * kPatchSide + 3;

/// A landmark's patch warped to an image, with its gradients, grey levels per px.
struct Template {
  alignas(64) float wanted[kCornerSide][kRow];
  alignas(64) float du[kCornerSide][kRow];
  alignas(64) float dv[kCornerSide][kRow];
};

/// Weights by distance from the centre.
struct CornerWindow {
  alignas(64) float weight[kCornerSide][kRow];
  float total;  ///< of the weights
};

/// Sums over a template of weight w, gradient (u, v), difference e (image minus template, mean
/// removed).
struct CornerSums {
  float square;  ///< grey levels squared, mean of e^2 by the window's weights
  float w, we;
  float u, v;        ///< w u, w v
  float uu, uv, vv;  ///< w u^2, w u v, w v^2
  float ue, ve;      ///< w u e, w v e
};

struct Kernels {
  const char* name;

  void (*prepare)(const Source& source, Pair* pair);

  /// Weights are the window's over 1 + e^2 / (tolerance square + noise).
  void (*sum_up)(const Pair& pair, const Window& window, const Place& place, float tolerance,
                 float noise, Sums* sums);

  /// Sums of absolute differences of the left patch and the right ones 2 kSlide + 1 columns along,
  /// with equal central pixels. The pointers are to the first pixels of the left patch and of the
  /// leftmost right patch; 11 and 21 columns of a row may be read.
  void (*slide)(const std::uint8_t* left, std::ptrdiff_t left_stride, const std::uint8_t* right,
                std::ptrdiff_t right_stride, std::int32_t* sums);

  /// \param back px of the stored patch per px of the template, 2x2 by rows; must stay inside the
  /// patch
  void (*warp)(const std::uint8_t* patch, const float* back, Template* to);

  /// Weights as in sum_up. \param image the pixel left of and above the template's first one;
  /// (kRow + 1) columns and (kCornerSide + 1) rows are read
  void (*sum_up_both)(const Template& wanted, const CornerWindow& window, const std::uint8_t* image,
                      std::ptrdiff_t stride, float fraction_x, float fraction_y, float tolerance,
                      float noise, CornerSums* sums);
};

/// The fastest variant for this machine.
const Kernels& kernels();
/// All variants for this machine, the portable one first.
std::span<const Kernels* const> available_kernels();

}  // namespace kys_slam::patch
