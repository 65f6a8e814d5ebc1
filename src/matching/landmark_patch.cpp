// SPDX-License-Identifier: BSD-3-Clause
#include "matching/landmark_patch.h"

#include <kys/portable_math.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "matching/image_border.h"

namespace kys_slam {

namespace {

using patch::kCornerHalf;
using patch::kCornerSide;
using patch::kPatchReach;
using patch::kPatchSide;

constexpr int kIterations = 6;
constexpr float kWindowSigma = 3;    // px
constexpr float kMaxMove = 1.5f;     // px
constexpr float kConverged = 0.01f;  // px
// Grey levels squared per px^2, of the direction with less contrast: below, noise decides.
constexpr float kMinContrast = 200;
// Weight of a pixel that is off by e: 1 / (1 + e^2 / (kTolerance residual^2 + kNoise)).
constexpr float kTolerance = 2.25f;
constexpr float kNoise = 9;  // grey levels squared

patch::CornerWindow make_window() {
  patch::CornerWindow window{};
  for (int y = 0; y < kCornerSide; ++y) {
    for (int x = 0; x < kCornerSide; ++x) {
      const int squared =
          (x - kCornerHalf) * (x - kCornerHalf) + (y - kCornerHalf) * (y - kCornerHalf);
      window.weight[y][x] =
          kys::portable::exp(-static_cast<float>(squared) / (2 * kWindowSigma * kWindowSigma));
      window.total += window.weight[y][x];
    }
  }
  return window;
}

/// Step of the centre by the normal equations, the mean of the differences eliminated; not a number
/// without contrast.
Eigen::Vector2f step_of(const patch::CornerSums& s) {
  Eigen::Matrix2f H;
  H << s.uu - s.u * s.u / s.w, s.uv - s.u * s.v / s.w, s.uv - s.u * s.v / s.w,
      s.vv - s.v * s.v / s.w;
  const Eigen::Vector2f b(s.ue - s.u * s.we / s.w, s.ve - s.v * s.we / s.w);
  const float half = 0.5f * H.trace(), determinant = H.determinant();
  const float least = half - std::sqrt(std::max(0.0f, half * half - determinant));
  if (!(least >= kMinContrast)) return Eigen::Vector2f::Constant(std::nanf(""));
  return Eigen::Vector2f(H(1, 1) * b.x() - H(0, 1) * b.y(), H(0, 0) * b.y() - H(1, 0) * b.x()) /
         determinant;
}

}  // namespace

std::optional<LandmarkPatch> cut_patch(const ImagePyramid& pyramid, int octave, float u, float v) {
  const auto level = static_cast<std::size_t>(octave);
  if (level >= pyramid.levels.size()) return {};
  const GrayImage& image = pyramid.levels[level];
  const Eigen::Vector2f at = pyramid.to_level(level, u, v);
  if (!surrounds(image, at, kPatchReach)) return {};
  const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
  const float fx = at.x() - static_cast<float>(x), fy = at.y() - static_cast<float>(y);
  LandmarkPatch patch;
  std::uint8_t* to = patch.pixels.data();
  for (int dy = -kPatchReach; dy <= kPatchReach; ++dy) {
    const std::uint8_t* upper = image.row(y + dy) + x - kPatchReach;
    const std::uint8_t* lower = image.row(y + dy + 1) + x - kPatchReach;
    const auto along = [&](const std::uint8_t* row, int k) {
      return static_cast<float>(row[k]) + fx * static_cast<float>(row[k + 1] - row[k]);
    };
    for (int k = 0; k < kPatchSide; ++k) {
      const float top = along(upper, k);
      *to++ = static_cast<std::uint8_t>(top + fy * (along(lower, k) - top) + 0.5f);
    }
  }
  return patch;
}

std::optional<PatchPosition> align_corner(const LandmarkPatch& patch, const Eigen::Matrix2f& warp,
                                          const ImagePyramid& pyramid, int octave, float u,
                                          float v) {
  static const patch::CornerWindow window = make_window();
  const auto level = static_cast<std::size_t>(octave);
  if (level >= pyramid.levels.size()) return {};
  const GrayImage& image = pyramid.levels[level];
  const Eigen::Vector2f start = pyramid.to_level(level, u, v);
  // The rows end with pixels that weigh nothing, which lie in the image's next row.
  if (!surrounds(image, start, kCornerHalf + kMaxMove)) return {};
  if (start.y() + kCornerHalf + kMaxMove + 3 > static_cast<float>(image.height())) return {};
  const Eigen::Matrix<float, 2, 2, Eigen::RowMajor> back = warp.inverse();
  const float reach = (kCornerHalf + 1) * back.cwiseAbs().rowwise().sum().maxCoeff();
  if (!(reach < kPatchReach)) return {};  // or not a number

  const patch::Kernels& kernels = patch::kernels();
  patch::Template wanted;
  kernels.warp(patch.pixels.data(), back.data(), &wanted);
  Eigen::Vector2f at = start;
  patch::CornerSums sums;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const int x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
    kernels.sum_up_both(wanted, window, image.row(y - kCornerHalf) + x - kCornerHalf, image.width(),
                        at.x() - static_cast<float>(x), at.y() - static_cast<float>(y), kTolerance,
                        kNoise, &sums);
    const Eigen::Vector2f step = step_of(sums);
    at -= step;
    if (!((at - start).lpNorm<Eigen::Infinity>() <= kMaxMove)) return {};  // or not a number
    if (step.lpNorm<Eigen::Infinity>() < kConverged) break;
  }
  const Eigen::Vector2f full = pyramid.to_full(level, at.x(), at.y());
  return PatchPosition{full.x(), full.y(), std::sqrt(sums.square)};
}

}  // namespace kys_slam
