// SPDX-License-Identifier: BSD-3-Clause
#include "matching/patch_alignment.h"

#include <kys/portable_math.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "matching/patch_kernels.h"

namespace kys_slam {

namespace {

using patch::kHalf;
using patch::kSide;

constexpr int kIterations = 8;
constexpr float kWindowSigma = 4;  // px
constexpr float kMaxMove = 1.5f;   // px
constexpr float kMaxSlantU = 0.6f;
constexpr float kMaxSlantV = 0.8f;
// What lies in a row of the strip, wherever the patch ends up.
static_assert(kHalf * (1 + kMaxSlantU + kMaxSlantV) + kMaxMove < patch::kReach);
// Slants are near zero rather than not, by as much as a hundred squared grey levels per px tell: a
// patch that shows one edge alone says nothing of them.
constexpr float kSlantPrior = 100;
// Weight of a pixel that is off by e: 1 / (1 + e^2 / (kTolerance residual^2 + kNoise)).
constexpr float kTolerance = 2.25f;
constexpr float kNoise = 9;  // grey levels squared

patch::Window make_window() {
  patch::Window window{};
  for (int x = 0; x < patch::kRow; ++x) {
    window.dx[x] = static_cast<float>(std::min(x, kSide - 1) - kHalf);
  }
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const int squared = (x - kHalf) * (x - kHalf) + (y - kHalf) * (y - kHalf);
      window.weight[y][x] =
          kys::portable::exp(-static_cast<float>(squared) / (2 * kWindowSigma * kWindowSigma));
      window.total += window.weight[y][x];
    }
  }
  return window;
}

/// Whether all pixels that the alignment reads are in both images.
bool fits(const GrayImage& left, const GrayImage& right, const Eigen::Vector2f& at,
          const Eigen::Vector2f& start) {
  // As floats: a conversion of what is far off or no number is not defined.
  const auto within = [](float x, float last) { return x >= 0 && x <= last; };
  const auto width = static_cast<float>(std::min(left.width(), right.width()) - 1);
  const auto height = static_cast<float>(std::min(left.height(), right.height()) - 1);
  return within(at.x() - kHalf - 1, width - 2 * kHalf - 3) &&
         within(at.y() - kHalf, height - 2 * kHalf - 1) &&
         within(start.x() - kHalf - 1, width - 2 * kHalf - 2) &&
         within(start.y() - kHalf, height - 2 * kHalf - 1);
}

patch::Source source_of(const GrayImage& left, const GrayImage& right, const Eigen::Vector2f& at,
                        const Eigen::Vector2f& start) {
  const int x = static_cast<int>(at.x()) - kHalf - 1;
  const int y = static_cast<int>(at.y()) - kHalf;
  const int right_y = static_cast<int>(start.y()) - kHalf;
  return {left.row(y) + x,
          left.width(),
          left.width() - x,
          right.row(right_y),
          right.width(),
          right.width(),
          static_cast<int>(start.x()) - patch::kReach,
          at.x() - std::floor(at.x()),
          at.y() - std::floor(at.y()),
          start.y() - std::floor(start.y())};
}

/// Step of column and slants by the normal equations, the mean of the differences eliminated.
Eigen::Vector3f step_of(const patch::Sums& s, const PatchAlignment& at) {
  Eigen::Matrix3f H;
  H << s.aa[0], s.aa[1], s.aa[3], s.aa[1], s.aa[2], s.aa[4], s.aa[3], s.aa[4], s.aa[5];
  const Eigen::Vector3f a(s.a[0], s.a[1], s.a[2]);
  Eigen::Vector3f b(s.ae[0], s.ae[1], s.ae[2]);
  H -= a * a.transpose() / s.w;
  b -= a * (s.we / s.w);
  if (!(H(0, 0) > 1)) return Eigen::Vector3f::Constant(std::nanf(""));
  H(1, 1) += kSlantPrior;
  H(2, 2) += kSlantPrior;
  b.y() += kSlantPrior * at.slant_u;
  b.z() += kSlantPrior * at.slant_v;
  return H.llt().solve(b);
}

}  // namespace

std::optional<PatchAlignment> align_patch(const GrayImage& left, const GrayImage& right,
                                          const Eigen::Vector2f& at, const Eigen::Vector2f& start) {
  static const patch::Window window = make_window();
  if (!fits(left, right, at, start)) return {};
  const patch::Kernels& kernels = patch::kernels();
  const patch::Source source = source_of(left, right, at, start);
  patch::Pair pair;
  kernels.prepare(source, &pair);
  PatchAlignment result{start.x(), 0, 0, 0};
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    patch::Sums sums;
    const patch::Place place{result.column - static_cast<float>(source.first), 1 + result.slant_u,
                             result.slant_v};
    kernels.sum_up(pair, window, place, kTolerance, kNoise, &sums);
    result.residual = std::sqrt(sums.square);
    const Eigen::Vector3f step = step_of(sums, result);
    result.column -= step.x();
    result.slant_u -= step.y();
    result.slant_v -= step.z();
    const bool near = std::abs(result.column - start.x()) <= kMaxMove &&
                      std::abs(result.slant_u) <= kMaxSlantU &&
                      std::abs(result.slant_v) <= kMaxSlantV;
    if (!near) return {};  // or not a number
    if (std::abs(step.x()) < 0.01f && step.tail<2>().lpNorm<Eigen::Infinity>() < 0.005f) break;
  }
  return result;
}

}  // namespace kys_slam
