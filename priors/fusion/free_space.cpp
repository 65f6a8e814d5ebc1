// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/free_space.h"

#include <kys_slam/util/median.h>

#include <algorithm>
#include <cmath>

#include "priors/fusion/segment_grid.h"

namespace kys_slam {
namespace {

constexpr int kWindow = 2;                           // px, by which a prediction may be off
constexpr double kSame = 1.0, kSameShare = 0.04;     // px and share of the disparity: its error
constexpr double kBeyond = 2.0, kBeyondShare = 0.1;  // likewise: the place is free beyond it

constexpr float kSurface = 1, kSurfaceShare = 0.15F;  // likewise: pixels of one surface
constexpr int kFewest = 50;                           // pixels that tell, or nothing is said; and
constexpr double kFewestShare = 0.25;                 // of those looked at

enum class Place { kUnknown, kOccupied, kFree, kHidden };

/// What the other frame sees at (u, v), where a surface of disparity d is expected.
Place look(const ImageOf<float>& other, double u, double v, double d) {
  const auto x = static_cast<int>(std::lround(u)), y = static_cast<int>(std::lround(v));
  if (x < kWindow || y < kWindow || x >= other.width() - kWindow || y >= other.height() - kWindow) {
    return Place::kUnknown;
  }
  int farther = 0, nearer = 0, known = 0;
  for (int j = y - kWindow; j <= y + kWindow; ++j) {
    for (int i = x - kWindow; i <= x + kWindow; ++i) {
      const double seen = other.at(i, j);
      if (!(seen > 0)) continue;
      ++known;
      if (std::abs(seen - d) <= kSame + kSameShare * d) return Place::kOccupied;
      farther += seen < d - (kBeyond + kBeyondShare * d) ? 1 : 0;
      nearer += seen > d ? 1 : 0;
    }
  }
  constexpr int kAll = (2 * kWindow + 1) * (2 * kWindow + 1);
  if (known < kAll / 2) return Place::kUnknown;
  if (farther == known) return Place::kFree;
  return nearer > 0 ? Place::kHidden : Place::kUnknown;
}

struct Pixel {
  int x, y;
  float disparity;  // px
};

/// Pixels of a thing that have a disparity, and how many were compared.
struct ThingSamples {
  std::vector<Pixel> known;
  int looked_at = 0;
};

std::vector<ThingSamples> sample(const ImageOf<float>& disparity, const SegmentRuns& runs,
                                 const std::vector<bool>& is_thing) {
  std::vector<ThingSamples> samples(is_thing.size());
  for_each_on_grid(
      runs, is_thing.size(), [&](auto segment) { return is_thing[segment]; },
      [&](auto segment, int x, int y) {
        ++samples[segment].looked_at;
        const float d = disparity.at(x, y);
        if (d > 0) samples[segment].known.push_back({x, y, d});
      });
  return samples;
}

/// Leaves the pixels of the surface that most are on: a segment's border and what it wrongly covers
/// have other depths.
void keep_surface(std::vector<Pixel>& pixels) {
  if (pixels.empty()) return;
  std::vector<float> d;
  d.reserve(pixels.size());
  for (const Pixel& p : pixels) d.push_back(p.disparity);
  const float middle = median(d);
  std::erase_if(pixels, [&](const Pixel& p) {
    return std::abs(p.disparity - middle) > kSurface + kSurfaceShare * middle;
  });
}

}  // namespace

std::vector<FreeSpaceEvidence> compare_space(const StereoCamera& camera, const Rigid3& T_other_now,
                                             bool right, const ImageOf<float>& disparity,
                                             const ImageOf<float>& other, const SegmentRuns& runs,
                                             const std::vector<bool>& is_thing) {
  // The right camera is the left one's baseline to the right.
  const Eigen::Vector3d offset(right ? camera.baseline : 0, 0, 0);
  const Eigen::Matrix3d R = T_other_now.R();
  const Eigen::Vector3d t = T_other_now.t() + R * offset - offset;
  std::vector<ThingSamples> samples = sample(disparity, runs, is_thing);
  std::vector<FreeSpaceEvidence> evidence(is_thing.size());
  for (std::size_t k = 1; k < samples.size(); ++k) {
    keep_surface(samples[k].known);
    FreeSpaceEvidence e;
    for (const Pixel& pixel : samples[k].known) {
      const double depth = camera.bf() / pixel.disparity;
      const Eigen::Vector3d p = R * camera.back_project(pixel.x, pixel.y, depth) + t;
      if (!(p.z() > 0.1)) continue;
      const Eigen::Vector2d at = camera.project(p);
      if (!camera.in_image(at.x(), at.y())) continue;
      switch (look(other, at.x(), at.y(), camera.bf() / p.z())) {
        case Place::kOccupied:
          ++e.occupied;
          break;
        case Place::kFree:
          ++e.free;
          break;
        case Place::kHidden:
          ++e.hidden;
          break;
        case Place::kUnknown:
          break;
      }
    }
    const int decided = e.occupied + e.free;
    if (decided >= kFewest && decided >= kFewestShare * samples[k].looked_at) evidence[k] = e;
  }
  return evidence;
}

}  // namespace kys_slam
