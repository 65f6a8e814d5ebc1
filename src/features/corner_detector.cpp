#include "features/corner_detector.h"

#include <algorithm>
#include <bit>

#include "features/kernels.h"

namespace kys_slam {

namespace {

constexpr int kGroup = kernels::kScoreGroup;
constexpr std::size_t kPad = 64;  // keeps the groups aligned

/// Cell of a coordinate when `extent` pixels from `margin` on are divided into `cells`.
int cell_of(int at, int margin, int extent, int cells) {
  return std::min(cells - 1, (at - margin) * cells / extent);
}

}  // namespace

void CornerDetector::resize(std::size_t groups) {
  for (ScoreRow& row : rows_) {
    row.scores.assign(2 * kPad + groups * kGroup, 0);
    row.groups.assign(groups, 0);
  }
}

void CornerDetector::collect(const GrayImage& image, const CornerOptions& options, int y,
                             const ScoreRow& above, const ScoreRow& row, const ScoreRow& below) {
  const auto suppress = kernels::kernels().suppress;
  // Scores start one pixel before the margin, so that the first corner has its neighbour.
  const int origin = options.margin - 1;
  const int count = image.width() - 2 * options.margin;
  for (std::size_t g = 0; g < row.groups.size(); ++g) {
    if (row.groups[g] == 0) continue;
    const std::size_t at = kPad + g * kGroup;
    std::uint64_t peaks =
        suppress(above.scores.data() + at, row.scores.data() + at, below.scores.data() + at);
    for (; peaks != 0; peaks &= peaks - 1) {
      const int i = static_cast<int>(g) * kGroup + std::countr_zero(peaks);
      if (i < 1 || i > count) continue;
      found_.push_back({static_cast<std::int16_t>(origin + i), static_cast<std::int16_t>(y),
                        row.scores[kPad + static_cast<std::size_t>(i)]});
    }
  }
}

void CornerDetector::detect(const GrayImage& image, const CornerOptions& options,
                            std::vector<Corner>& corners) {
  corners.clear();
  const int width = image.width() - 2 * options.margin;
  const int height = image.height() - 2 * options.margin;
  if (width <= 0 || height <= 0) return;
  const auto fast_score = kernels::kernels().fast_score;
  resize(static_cast<std::size_t>((width + 2 + kGroup - 1) / kGroup));
  found_.clear();
  const int first = options.margin - 1;
  for (int y = first; y <= options.margin + height; ++y) {
    ScoreRow& row = rows_[y % 3];
    fast_score(image.row(y) + first, image.width(), width + 2, options.min_threshold,
               row.scores.data() + kPad, row.groups.data());
    if (y >= first + 2) collect(image, options, y - 1, rows_[(y - 2) % 3], rows_[(y - 1) % 3], row);
  }

  const int columns = std::max(1, width / options.cell);
  const int rows = std::max(1, height / options.cell);
  strong_.assign(static_cast<std::size_t>(columns * rows), 0);
  column_of_.resize(static_cast<std::size_t>(image.width()));
  for (int x = options.margin; x < options.margin + width; ++x) {
    column_of_[static_cast<std::size_t>(x)] = cell_of(x, options.margin, width, columns);
  }
  const auto cell = [&](const Corner& c) {
    return static_cast<std::size_t>(cell_of(c.y, options.margin, height, rows) * columns +
                                    column_of_[static_cast<std::size_t>(c.x)]);
  };
  for (const Corner& c : found_) {
    if (c.score >= options.threshold) strong_[cell(c)] = 1;
  }
  for (const Corner& c : found_) {
    if (c.score >= options.threshold || strong_[cell(c)] == 0) corners.push_back(c);
  }
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
