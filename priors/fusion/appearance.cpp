// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/appearance.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <variant>

#include "priors/fusion/segment_grid.h"

namespace kys_slam {
namespace {

constexpr int kRadius = 3;  // px, of a patch
constexpr int kSlack = 2;   // px, by which a prediction may be off
constexpr int kMargin = kRadius + 1;
constexpr std::size_t kPatches = 150;  // per segment
constexpr double kCorner = 30;  // squared grey levels, least eigenvalue of the gradients' mean
constexpr double kAlike = 0.8;  // correlation

struct Patch {
  int x, y;         // px
  double strength;  // squared grey levels
};

bool inside(const GrayImage& image, int x, int y, int margin) {
  return x >= margin && y >= margin && x < image.width() - margin && y < image.height() - margin;
}

/// Least eigenvalue of the mean outer product of the gradients in the patch.
double corner_strength(const GrayImage& image, int x, int y) {
  double xx = 0, xy = 0, yy = 0;
  for (int v = y - kRadius; v <= y + kRadius; ++v) {
    for (int u = x - kRadius; u <= x + kRadius; ++u) {
      const double gx = 0.5 * (image.at(u + 1, v) - image.at(u - 1, v));
      const double gy = 0.5 * (image.at(u, v + 1) - image.at(u, v - 1));
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  constexpr double kCount = (2 * kRadius + 1) * (2 * kRadius + 1);
  const double mean = 0.5 * (xx + yy) / kCount, half = 0.5 * (xx - yy) / kCount;
  return mean - std::sqrt(half * half + xy * xy / (kCount * kCount));
}

double correlation(const GrayImage& a, int ax, int ay, const GrayImage& b, int bx, int by) {
  int sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int v = -kRadius; v <= kRadius; ++v) {
    for (int u = -kRadius; u <= kRadius; ++u) {
      const int p = a.at(ax + u, ay + v), q = b.at(bx + u, by + v);
      sa += p;
      sb += q;
      saa += p * p;
      sbb += q * q;
      sab += p * q;
    }
  }
  constexpr double kCount = (2 * kRadius + 1) * (2 * kRadius + 1);
  const double va = saa - sa * (sa / kCount), vb = sbb - sb * (sb / kCount);
  if (va <= 0 || vb <= 0) return 0;
  return (sab - sa * (sb / kCount)) / std::sqrt(va * vb);
}

/// Does the patch look the same around (u, v) of the next image? -1: that is outside of it.
int looks_alike(const GrayImage& now, const Patch& patch, const GrayImage& next, float u, float v) {
  if (!(std::abs(u) < 1e5F && std::abs(v) < 1e5F)) return -1;
  const auto x = static_cast<int>(std::lround(u)), y = static_cast<int>(std::lround(v));
  if (!inside(next, x, y, kRadius + kSlack)) return -1;
  for (int dy = -kSlack; dy <= kSlack; ++dy) {
    for (int dx = -kSlack; dx <= kSlack; ++dx) {
      if (correlation(now, patch.x, patch.y, next, x + dx, y + dy) >= kAlike) return 1;
    }
  }
  return 0;
}

}  // namespace

std::vector<AppearanceEvidence> compare_appearance(const GrayImage& now, const GrayImage& next,
                                                   const EgoMotion& motion, const FlowField& flow,
                                                   const ImageOf<float>& disparity,
                                                   const InverseDepth& inverse_depth,
                                                   const SegmentRuns& runs,
                                                   const std::vector<std::uint8_t>& is_stuff) {
  std::vector<std::vector<Patch>> patches(is_stuff.size());
  for_each_on_grid(
      runs, is_stuff.size(), [&](auto segment) { return !is_stuff[segment]; },
      [&](auto segment, int x, int y) {
        if (!(disparity.at(x, y) > 0) || !inside(now, x, y, kMargin)) return;
        const double strength = corner_strength(now, x, y);
        if (strength >= kCorner) patches[segment].push_back({x, y, strength});
      });
  std::vector<AppearanceEvidence> evidence(is_stuff.size());
  for (std::size_t k = 1; k < patches.size(); ++k) {
    std::vector<Patch>& all = patches[k];
    const std::size_t count = std::min(all.size(), kPatches);
    std::partial_sort(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count), all.end(),
                      [](const Patch& a, const Patch& b) {
                        return std::tuple(-a.strength, a.y, a.x) <
                               std::tuple(-b.strength, b.y, b.x);
                      });
    all.resize(count);
    int still = 0, stills = 0, moved = 0, moves = 0;
    for (const Patch& patch : all) {
      const auto x = static_cast<float>(patch.x), y = static_cast<float>(patch.y);
      float u = 0, v = 0;
      std::visit(
          [&](const auto& row) { row.at(x, inverse_depth(disparity.at(patch.x, patch.y)), u, v); },
          motion.flow_row(patch.y));
      const int a = looks_alike(now, patch, next, x + u, y + v);
      if (a < 0) continue;
      ++stills;
      still += a;
      const int b = looks_alike(now, patch, next, x + flow.u.at(patch.x, patch.y),
                                y + flow.v.at(patch.x, patch.y));
      if (b < 0) continue;
      ++moves;
      moved += b;
    }
    AppearanceEvidence& e = evidence[k];
    e.patches = stills;
    e.flow_patches = moves;
    e.still = stills > 0 ? static_cast<double>(still) / stills : 0;
    e.flow = moves > 0 ? static_cast<double>(moved) / moves : 0;
  }
  return evidence;
}

}  // namespace kys_slam
