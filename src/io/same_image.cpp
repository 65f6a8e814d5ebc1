// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/same_image.h>
#include <kys_slam/util/median.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

namespace kys_slam {
namespace {

constexpr int kColumns = 20, kRows = 12;  // cells, of which each gives its steepest pixel
constexpr int kRadius = 4;                // px of a patch
constexpr int kLeastStep = 12;            // levels from pixel to pixel
constexpr std::size_t kFewest = 30;       // patches to decide by
constexpr std::size_t kFirst = 24;  // patches, of which some have to fit, to look at the others
constexpr int kFewestOfFirst = 8;
constexpr double kFitting = 0.9;             // share of the half of the patches with most contrast
constexpr double kLargestDifference = 0.25;  // squared differences, of the variance of the patch
constexpr double kLargestShift = 0.25;       // px of one patch
constexpr double kLargestMedian = 0.1;       // px

struct Pixel {
  int x = 0, y = 0;
};

/// The pixel with the largest horizontal step in a cell, of every second row and column.
std::optional<Pixel> steepest(const GrayImage& image, int column, int row) {
  constexpr int kBorder = kRadius + 2;
  const int width = (image.width() - 2 * kBorder) / kColumns;
  const int height = (image.height() - 2 * kBorder) / kRows;
  int largest = kLeastStep;
  std::optional<Pixel> found;
  for (int y = kBorder + row * height; y < kBorder + (row + 1) * height; y += 2) {
    const std::uint8_t* p = image.row(y);
    for (int x = kBorder + column * width; x < kBorder + (column + 1) * width; x += 2) {
      const int step = std::abs(p[x + 1] - p[x - 1]);
      if (step <= largest) continue;
      largest = step;
      found = Pixel{x, y};
    }
  }
  return found;
}

/// Sums over a patch of the left image: its variance, and squared differences to the right image
/// shifted by -1, 0 and 1 px.
struct Patch {
  double variance = 0;
  std::array<double, 3> difference{};
};

Patch compare(const GrayImage& left, const GrayImage& right, const Pixel& at) {
  Patch patch;
  double sum = 0, squares = 0;
  for (int y = at.y - kRadius; y <= at.y + kRadius; ++y) {
    const std::uint8_t *l = left.row(y), *r = right.row(y);
    for (int x = at.x - kRadius; x <= at.x + kRadius; ++x) {
      sum += l[x];
      squares += l[x] * l[x];
      for (int s = -1; s <= 1; ++s) {
        const int d = l[x] - r[x + s];
        patch.difference[static_cast<std::size_t>(s + 1)] += d * d;
      }
    }
  }
  constexpr int kPixels = (2 * kRadius + 1) * (2 * kRadius + 1);
  patch.variance = squares - sum * sum / kPixels;
  return patch;
}

/// Where the right image has the patch, px from its place in the left one; nothing when not there.
std::optional<double> shift_of(const Patch& patch) {
  const auto& [before, here, after] = patch.difference;
  if (here > kLargestDifference * patch.variance || here > before || here > after) {
    return std::nullopt;
  }
  const double curvature = before - 2 * here + after;
  if (!(curvature > 0)) return std::nullopt;
  return 0.5 * (before - after) / curvature;
}

}  // namespace

bool is_same_image(const GrayImage& left, const GrayImage& right) {
  if (left.width() != right.width() || left.height() != right.height()) return false;
  std::vector<Patch> patches;
  const auto fits = [](const Patch& p) {
    const auto shift = shift_of(p);
    return shift && std::abs(*shift) < kLargestShift;
  };
  for (int i = 0; i < kColumns * kRows; ++i) {
    const int cell = i * 97 % (kColumns * kRows);  // all over the image
    const auto pixel = steepest(left, cell % kColumns, cell / kColumns);
    if (!pixel) continue;
    patches.push_back(compare(left, right, *pixel));
    if (patches.size() != kFirst) continue;
    if (std::count_if(patches.begin(), patches.end(), fits) < kFewestOfFirst) return false;
  }
  if (patches.size() < kFewest) return false;
  // What was encoded again has noise that hides what is faint.
  const auto half = patches.begin() + static_cast<std::ptrdiff_t>(patches.size() / 2);
  std::nth_element(patches.begin(), half, patches.end(),
                   [](const Patch& a, const Patch& b) { return a.variance > b.variance; });
  patches.erase(half, patches.end());
  std::vector<double> shifts;
  for (const Patch& p : patches) {
    if (fits(p)) shifts.push_back(*shift_of(p));
  }
  return static_cast<double>(shifts.size()) >= kFitting * static_cast<double>(patches.size()) &&
         std::abs(median(shifts)) < kLargestMedian;
}

}  // namespace kys_slam
