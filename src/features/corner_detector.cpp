// SPDX-License-Identifier: BSD-3-Clause
#include "features/corner_detector.h"

#include <algorithm>
#include <bit>

#include "features/kernels.h"

namespace kys_slam {

void describe(kys::OptionList& list, CornerOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("corners.threshold", o.threshold, {1, 254}, "grey levels");
  list.add("corners.min_threshold", o.min_threshold, {1, 254}, "grey levels");
  list.add("corners.margin", o.margin, {4, 10000}, "px");
  list.add("corners.cell", o.cell, {1, 10000}, "px");
}

namespace {

constexpr int kGroup = kernels::kScoreGroup;
constexpr std::size_t kPad = 64;  // keeps the groups aligned

/// Cell of a coordinate when `extent` pixels from `margin` on are divided into `cells`.
int cell_of(int at, int margin, int extent, int cells) {
  return std::min(cells - 1, (at - margin) * cells / extent);
}

}  // namespace

std::uint8_t* CornerDetector::score_row(int y) {
  return scores_.data() + static_cast<std::size_t>(y - origin_) * (row_groups_ * kGroup + kPad) +
         kPad;
}

void CornerDetector::find_peaks(const CornerOptions& options, int width, int height, int y) {
  const kernels::Kernels& k = kernels::kernels();
  const std::uint8_t* above = score_row(y - 1);
  const std::uint8_t* row = score_row(y);
  const std::uint8_t* below = score_row(y + 1);
  const std::size_t first = static_cast<std::size_t>(y - origin_) * row_groups_;
  const auto cell_row =
      static_cast<std::size_t>(cell_of(y, options.margin, height, static_cast<int>(cell_rows_)));
  for (std::size_t g = 0; g < row_groups_; ++g) {
    Peaks& peaks = peaks_[first + g];
    peaks = {};
    if (groups_[first + g] == 0) continue;
    const std::size_t at = g * kGroup;
    // Column 0 and those after the last are beyond the margin.
    const std::size_t end = static_cast<std::size_t>(width) + 1;
    const std::uint64_t inside = (g == 0 ? ~std::uint64_t{1} : ~std::uint64_t{0}) &
                                 (end >= at + kGroup ? ~std::uint64_t{0}
                                  : end <= at        ? 0
                                                     : (std::uint64_t{1} << (end - at)) - 1);
    peaks.all = k.suppress(above + at, row + at, below + at) & inside;
    peaks.strong = peaks.all & k.at_least(row + at, options.threshold);
    for (std::uint64_t bits = peaks.strong; bits != 0; bits &= bits - 1) {
      const std::size_t x = at + static_cast<std::size_t>(std::countr_zero(bits));
      strong_[cell_row * cell_columns_ + column_of_[x]] = 1;
    }
  }
}

void CornerDetector::mark_weak_cells(std::size_t cell_row) {
  weak_cells_.assign(row_groups_, 0);
  for (std::size_t c = 0; c < cell_columns_; ++c) {
    if (strong_[cell_row * cell_columns_ + c] != 0) continue;
    std::size_t x = column_begin_[c];
    const std::size_t end = column_begin_[c + 1];
    while (x < end) {  // group by group
      const std::size_t stop = std::min(end, (x / kGroup + 1) * kGroup);
      const std::uint64_t run = ~std::uint64_t{0} >> (kGroup - (stop - x));
      weak_cells_[x / kGroup] |= run << (x % kGroup);
      x = stop;
    }
  }
}

void CornerDetector::collect(const CornerOptions& options, int height,
                             std::vector<Corner>& corners) {
  std::size_t marked = cell_rows_;  // none yet
  for (int y = options.margin; y < options.margin + height; ++y) {
    const auto cell_row =
        static_cast<std::size_t>(cell_of(y, options.margin, height, static_cast<int>(cell_rows_)));
    if (cell_row != marked) mark_weak_cells(marked = cell_row);
    const std::uint8_t* row = score_row(y);
    const Peaks* peaks = peaks_.data() + static_cast<std::size_t>(y - origin_) * row_groups_;
    for (std::size_t g = 0; g < row_groups_; ++g) {
      std::uint64_t kept = peaks[g].strong | (peaks[g].all & weak_cells_[g]);
      for (; kept != 0; kept &= kept - 1) {
        const int x = static_cast<int>(g) * kGroup + std::countr_zero(kept);
        corners.push_back(
            {static_cast<std::int16_t>(origin_ + x), static_cast<std::int16_t>(y), row[x]});
      }
    }
  }
}

void CornerDetector::detect(const GrayImage& image, const CornerOptions& options,
                            std::vector<Corner>& corners) {
  corners.clear();
  const int width = image.width() - 2 * options.margin;
  const int height = image.height() - 2 * options.margin;
  if (width <= 0 || height <= 0) return;
  // One pixel more all around, so that the outermost corners have their neighbours.
  origin_ = options.margin - 1;
  const std::size_t groups = (static_cast<std::size_t>(width) + 2 + kGroup - 1) / kGroup;
  const auto rows_scored = static_cast<std::size_t>(height) + 2;
  const std::size_t stride = groups * kGroup + kPad;
  row_groups_ = groups;
  scores_.resize(std::max(scores_.size(), rows_scored * stride + kPad));
  // Scores are written before they are read; the padding moves with the size of the image.
  for (std::size_t r = 0; r <= rows_scored; ++r) std::fill_n(&scores_[r * stride], kPad, 0);
  groups_.resize(rows_scored * groups);
  peaks_.resize(rows_scored * groups);
  cell_columns_ = static_cast<std::size_t>(std::max(1, width / options.cell));
  cell_rows_ = static_cast<std::size_t>(std::max(1, height / options.cell));
  strong_.assign(cell_columns_ * cell_rows_, 0);
  column_of_.assign(static_cast<std::size_t>(width) + 2, 0);
  column_begin_.assign(cell_columns_ + 1, static_cast<std::size_t>(width) + 1);
  for (int x = width - 1; x >= 0; --x) {
    const auto at = static_cast<std::size_t>(x) + 1;
    column_of_[at] =
        static_cast<std::uint32_t>(cell_of(x, 0, width, static_cast<int>(cell_columns_)));
    column_begin_[column_of_[at]] = at;
  }
  const auto fast_score = kernels::kernels().fast_score;
  for (int y = origin_; y <= options.margin + height; ++y) {
    fast_score(image.row(y) + origin_, image.width(), width + 2, options.min_threshold,
               score_row(y), groups_.data() + static_cast<std::size_t>(y - origin_) * groups);
    if (y >= origin_ + 2) find_peaks(options, width, height, y - 1);
  }
  collect(options, height, corners);
}

std::array<float, 2> CornerDetector::subpixel(const Corner& corner) const {
  const auto stride = static_cast<std::ptrdiff_t>(row_groups_ * kGroup + kPad);
  const std::uint8_t* centre =
      scores_.data() + kPad + (corner.y - origin_) * stride + (corner.x - origin_);
  const auto at = [&](int u, int v) { return static_cast<int>(centre[v * stride + u]); };
  // Sums over the columns and rows of the 3x3 block; scaled so that everything stays integer.
  const int left = at(-1, -1) + at(-1, 0) + at(-1, 1);
  const int right = at(1, -1) + at(1, 0) + at(1, 1);
  const int top = at(-1, -1) + at(0, -1) + at(1, -1);
  const int bottom = at(-1, 1) + at(0, 1) + at(1, 1);
  const int column = at(0, -1) + at(0, 0) + at(0, 1);
  const int row = at(-1, 0) + at(0, 0) + at(1, 0);
  const double gx = (right - left) / 6.0;
  const double gy = (bottom - top) / 6.0;
  const double xx = (right - 2 * column + left) / 3.0;
  const double yy = (bottom - 2 * row + top) / 3.0;
  const double xy = (at(1, 1) - at(-1, 1) - at(1, -1) + at(-1, -1)) / 4.0;
  const double determinant = xx * yy - xy * xy;
  if (!(determinant > 1e-9) || xx >= 0) return {0, 0};  // no peak
  const double dx = (xy * gy - yy * gx) / determinant;
  const double dy = (xy * gx - xx * gy) / determinant;
  return {static_cast<float>(std::clamp(dx, -0.5, 0.5)),
          static_cast<float>(std::clamp(dy, -0.5, 0.5))};
}

GrayImage fast_score_map(const GrayImage& image, int min_threshold, int margin) {
  GrayImage map(image.width(), image.height());
  const int width = image.width() - 2 * margin;
  if (width <= 0) return map;
  const auto groups = static_cast<std::size_t>((width + kGroup - 1) / kGroup);
  std::vector<std::uint8_t> scores(groups * kGroup);
  std::vector<std::uint8_t> any(groups);
  for (int y = margin; y < image.height() - margin; ++y) {
    kernels::kernels().fast_score(image.row(y) + margin, image.width(), width, min_threshold,
                                  scores.data(), any.data());
    std::copy_n(scores.data(), width, map.row(y) + margin);
  }
  return map;
}

}  // namespace kys_slam
