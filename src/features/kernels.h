// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

/// The inner loops of the ORB extractor, compiled once per instruction set from kernels.inc. Every
/// variant gives the same bytes; kernels() returns the fastest one for this machine.
namespace kys_slam::kernels {

/// Pixels of a row that are scored and suppressed together.
inline constexpr int kScoreGroup = 64;
/// Output pixels of one reduction group (see ResizeGroup).
inline constexpr int kResizeGroup = 8;
/// Radius of the patch whose intensity centroid orients a keypoint, px (ORB).
inline constexpr int kPatchRadius = 15;
/// Point pairs of a descriptor.
inline constexpr int kPairs = 256;

/// Taps of eight neighbouring output pixels of a row, from at most 16 input pixels: out[i] =
/// (in[first + left[2 i]] w[2 i] + in[first + left[2 i + 1]] w[2 i + 1]) / 256.
struct ResizeGroup {
  std::uint8_t tap[16];     ///< offsets of the two taps of each output, from `first`
  std::uint8_t weight[16];  ///< their weights, which add up to 256
};

/// Intensity moments of a patch: sum of u I and sum of v I over the disc, u right, v down.
struct Moments {
  std::int32_t m10 = 0;
  std::int32_t m01 = 0;
};

struct Kernels {
  const char* name;

  /// FAST-9/16 score of `count` pixels of a row from `row`: the largest threshold t for which nine
  /// contiguous circle pixels are all > I + t or all < I - t, or 0 where that is below
  /// `min_threshold`. Reads three pixels beyond on each side and three rows above and below.
  /// `groups[i]` is non-zero when the i-th group of kScoreGroup pixels has a non-zero score.
  /// `score` must have capacity for whole groups; scores beyond `count` are set to 0.
  void (*fast_score)(const std::uint8_t* row, std::ptrdiff_t stride, int count, int min_threshold,
                     std::uint8_t* score, std::uint8_t* groups);

  /// 3x3 non-maximum suppression of one group of kScoreGroup scores: bit i is set where score i
  /// exceeds the neighbours before it in raster order and is no less than those after it. The
  /// pointers are to the group in three successive rows; one score before and one after the group
  /// are read.
  std::uint64_t (*suppress)(const std::uint8_t* above, const std::uint8_t* row,
                            const std::uint8_t* below);

  /// Bit i is set where score i of a group is at least `threshold`.
  std::uint64_t (*at_least)(const std::uint8_t* row, int threshold);

  /// Horizontal half of the bilinear reduction: a row of `groups` times eight values
  /// (I - 128) * 128 rounded down. `first[i]` + 15 must lie inside the row.
  void (*resize_row)(const std::uint8_t* row, const std::int32_t* first, const ResizeGroup* group,
                     int groups, std::int16_t* out);

  /// Vertical half: rows above and below blended, `weight` of the lower one in 1/32768.
  void (*blend_rows)(const std::int16_t* upper, const std::int16_t* lower, int weight, int count,
                     std::uint8_t* out);

  /// One row of the 7x7 Gaussian (sigma 2): `rows` are the seven input rows, `column` is scratch of
  /// count + 6 values. Columns beyond the ends repeat the end pixel.
  void (*blur_row)(const std::uint8_t* const* rows, int count, std::uint16_t* column,
                   std::uint8_t* out);

  /// Moments of the disc of kPatchRadius around `centre`. Reads 32 pixels of each of its rows,
  /// columns -15..16.
  Moments (*moments)(const std::uint8_t* centre, std::ptrdiff_t stride);

  /// 256-bit steered BRIEF at `centre`: bit i is set where the pixel at (x[i], y[i]) is darker than
  /// the one at (x[256 + i], y[256 + i]), both turned by the angle of that cosine and sine and
  /// rounded. Points are less than 31 from the centre.
  void (*describe)(const std::uint8_t* centre, std::int32_t stride, const float* x, const float* y,
                   float cosine, float sine, std::uint64_t* words);
};

/// The fastest variant for this machine.
const Kernels& kernels();
/// All variants for this machine, the portable one first.
std::span<const Kernels* const> available_kernels();

}  // namespace kys_slam::kernels
