// SPDX-License-Identifier: BSD-3-Clause
#include "matching/row_alignment.h"

#include <kys/portable_math.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "matching/image_border.h"

namespace kys_slam {

namespace {

constexpr int kReach = 5;  // px of the octave, half side of the patch
constexpr int kSide = 2 * kReach + 1;
constexpr int kSteps = 10;
constexpr int kCoarsest = 4;         // octave: coarser corners tell rows to a pixel only
constexpr float kWindowSigma = 4;    // px
constexpr float kMaxMove = 2.5f;     // px
constexpr float kConverged = 0.01f;  // px
// Grey levels squared per px^2, of the direction with less contrast: below, noise decides.
constexpr float kMinContrast = 400;
// Weight of a pixel that is off by e: 1 / (1 + e^2 / (kTolerance residual^2 + kNoise)).
constexpr float kTolerance = 2.25f;
constexpr float kNoise = 9;         // grey levels squared
constexpr float kSlantPrior = 100;  // as in patch_alignment.cpp

using Patch = std::array<float, static_cast<std::size_t>(kSide) * kSide>;

/// Grey levels and gradients of the left image around a place.
struct Wanted {
  Patch grey, du, dv;
};

float sample(const GrayImage& image, float x, float y) {
  const int column = static_cast<int>(x), row = static_cast<int>(y);
  const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
  const std::uint8_t* upper = image.row(row) + column;
  const std::uint8_t* lower = upper + image.width();
  const float top = static_cast<float>(upper[0]) + fx * static_cast<float>(upper[1] - upper[0]);
  const float bottom = static_cast<float>(lower[0]) + fx * static_cast<float>(lower[1] - lower[0]);
  return top + fy * (bottom - top);
}

Wanted cut(const GrayImage& left, const Eigen::Vector2f& at) {
  Wanted wanted;
  std::size_t k = 0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx, ++k) {
      const float x = at.x() + static_cast<float>(dx), y = at.y() + static_cast<float>(dy);
      wanted.grey[k] = sample(left, x, y);
      wanted.du[k] = 0.5f * (sample(left, x + 1, y) - sample(left, x - 1, y));
      wanted.dv[k] = 0.5f * (sample(left, x, y + 1) - sample(left, x, y - 1));
    }
  }
  return wanted;
}

Patch window() {
  Patch weights;
  std::size_t k = 0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx, ++k) {
      weights[k] = kys::portable::exp(-static_cast<float>(dx * dx + dy * dy) /
                                      (2 * kWindowSigma * kWindowSigma));
    }
  }
  return weights;
}

/// Place of a patch and how its columns grow along and across rows, beyond one and zero.
using Place = Eigen::Vector4f;  // column, row, slant_u, slant_v

/// The least of the two eigenvalues of what a patch tells about its place.
float contrast_of(const Eigen::Matrix4f& H) {
  const float half = 0.5f * (H(0, 0) + H(1, 1));
  const float determinant = H(0, 0) * H(1, 1) - H(0, 1) * H(0, 1);
  return half - std::sqrt(std::max(0.0f, half * half - determinant));
}

std::optional<Place> step_of(const GrayImage& right, const Wanted& wanted, const Patch& weights,
                             const Place& at) {
  Patch e;
  float total = 0, sum = 0, square = 0;
  std::size_t k = 0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx, ++k) {
      const auto x = static_cast<float>(dx), y = static_cast<float>(dy);
      e[k] = sample(right, at[0] + x * (1 + at[2]) + y * at[3], at[1] + y) - wanted.grey[k];
      total += weights[k];
      sum += weights[k] * e[k];
      square += weights[k] * e[k] * e[k];
    }
  }
  const float mean = sum / total;
  const float bound = 1 / (kTolerance * (square / total - mean * mean) + kNoise);
  Eigen::Matrix4f H = Eigen::Matrix4f::Zero();
  Eigen::Vector4f a = Eigen::Vector4f::Zero(), b = Eigen::Vector4f::Zero();
  float w_sum = 0, we_sum = 0;
  k = 0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx, ++k) {
      const float off = e[k] - mean;
      const float w = weights[k] / (1 + off * off * bound);
      const Eigen::Vector4f g(wanted.du[k], wanted.dv[k], wanted.du[k] * static_cast<float>(dx),
                              wanted.du[k] * static_cast<float>(dy));
      H.noalias() += w * g * g.transpose();
      a += w * g;
      b += w * off * g;
      w_sum += w;
      we_sum += w * off;
    }
  }
  H -= a * a.transpose() / w_sum;
  b -= a * (we_sum / w_sum);
  if (!(contrast_of(H) >= kMinContrast)) return {};
  for (int i = 2; i < 4; ++i) {
    H(i, i) += kSlantPrior;
    b[i] += kSlantPrior * at[i];
  }
  return Place(H.llt().solve(b));
}

/// Row in the right image (px of the octave) of the left patch, beginning at `start`.
std::optional<float> align_row(const GrayImage& left, const GrayImage& right,
                               const Eigen::Vector2f& at, const Eigen::Vector2f& start) {
  static const Patch weights = window();
  constexpr float kMostSlant = 0.5f;
  constexpr float kMost = kReach * (1 + 2 * kMostSlant) + kMaxMove;
  if (!surrounds(left, at, kReach + 1) || !surrounds(right, start, kMost)) return {};
  const Wanted wanted = cut(left, at);
  Place place(start.x(), start.y(), 0, 0);
  for (int i = 0; i < kSteps; ++i) {
    const std::optional<Place> step = step_of(right, wanted, weights, place);
    if (!step) return {};
    place -= *step;
    const bool near = std::abs(place[0] - start.x()) <= kMaxMove &&
                      std::abs(place[1] - start.y()) <= kMaxMove &&
                      place.tail<2>().lpNorm<Eigen::Infinity>() <= kMostSlant;
    if (!near) return {};  // or not a number
    if (step->head<2>().lpNorm<Eigen::Infinity>() < kConverged) return place[1];
  }
  return {};
}

}  // namespace

std::vector<float> measure_rows(const StereoView& left, const StereoView& right,
                                std::span<const float> u_right, const RigCorrection& rig,
                                std::size_t most) {
  std::vector<float> rows(u_right.size(), std::nanf(""));
  const auto is_candidate = [&](std::size_t i) {
    return !std::isnan(u_right[i]) && left.features->keypoints[i].octave <= kCoarsest;
  };
  std::size_t candidates = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) candidates += is_candidate(i) ? 1 : 0;
  const std::size_t every = std::max<std::size_t>(1, (candidates + most - 1) / most);
  std::size_t seen = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!is_candidate(i) || seen++ % every != 0) continue;
    const Keypoint& k = left.features->keypoints[i];
    const std::size_t level = k.octave;
    const RigCorrection::Ideal ideal = rig.pair({k.x, k.y, u_right[i]});
    const auto expected =
        static_cast<float>(rig.measured_right(ideal.u, ideal.v, ideal.u_right).y());
    const std::optional<float> row =
        align_row(left.pyramid->levels[level], right.pyramid->levels[level],
                  left.pyramid->to_level(level, k.x, k.y),
                  right.pyramid->to_level(level, u_right[i], expected));
    if (row) rows[i] = right.pyramid->to_full(level, 0, *row).y();
  }
  return rows;
}

}  // namespace kys_slam
