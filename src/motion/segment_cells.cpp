// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "motion/segment_carrier.h"
#include "motion/segment_carrying.h"

// The cells of the image, moved to other frames.

namespace kys_slam {

namespace {

constexpr double kLargestSplat = 4;   // cells, half side
constexpr std::size_t kMostFar = 60;  // features beyond kSurfaceRadius that are compared
constexpr int kGap = 2;               // cells, on each side

}  // namespace

/// How far away the cells of the image are: by the nearest features of their segments. An instance
/// without a disparity is about as far away as what surrounds it, other segments are far.
void SegmentCarrier::sample_depths() {
  columns_ = (camera_.width + carrying::kCell - 1) / carrying::kCell;
  rows_ = (camera_.height + carrying::kCell - 1) / carrying::kCell;
  cells_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  std::vector<std::uint32_t> all;
  for (const std::vector<std::uint32_t>& members : members_) {
    all.insert(all.end(), members.begin(), members.end());
  }
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const double u = carrying::kCell * column + 0.5 * (carrying::kCell - 1),
                   v = carrying::kCell * row + 0.5 * (carrying::kCell - 1);
      const std::uint16_t segment = at(u, v);
      if (segment == 0) continue;
      const std::vector<std::uint32_t>& own = members_[segment - 1U];
      const bool by_others = own.empty() && is_thing(segment);
      cells_[static_cast<std::size_t>(row * columns_ + column)] = {
          segment, static_cast<float>(depth_at(segment, by_others ? all : own, u, v))};
    }
  }
}

/// m; of the nearest three of some features, by the inverse square of their distance.
double SegmentCarrier::depth_at(std::uint16_t segment, std::span<const std::uint32_t> among,
                                double u, double v) const {
  std::array<std::pair<double, double>, 3> nearest;  // squared distance, disparity
  nearest.fill({1e300, 0});
  const auto see = [&](std::size_t i) {
    const double du = features_->keypoint(i).x - u, dv = features_->keypoint(i).y - v;
    const double distance = 1 + du * du + dv * dv;
    if (distance >= nearest.back().first) return;
    nearest.back() = {distance, carrying::disparity_of(*features_, i)};
    std::sort(nearest.begin(), nearest.end());
  };
  features_->for_each_near(static_cast<float>(u), static_cast<float>(v),
                           static_cast<float>(carrying::kSurfaceRadius * camera_.width), 0,
                           carrying::kOctaves, [&](std::size_t i) {
                             if (segment_of_feature_[i] == segment && features_->has_stereo(i)) {
                               see(i);
                             }
                           });
  if (nearest.front().first > 1e200) {
    const std::size_t step = 1 + among.size() / kMostFar;
    for (std::size_t k = 0; k < among.size(); k += step) see(among[k]);
  }
  double sum = 0;
  double weights = 0;
  for (const auto& [distance, disparity] : nearest) {
    sum += disparity / distance;
    weights += 1 / distance;
  }
  return sum > weights * camera_.bf() / carrying::kFar ? camera_.bf() * weights / sum
                                                       : carrying::kFar;
}

/// The cells moved to another frame; where several come together the nearest one is seen.
std::vector<SegmentCarrier::Cell> SegmentCarrier::warp(const Rigid3& T_now_s,
                                                       const SegmentShifts& shifts) const {
  std::vector<Cell> moved(cells_.size());
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(row * columns_ + column)];
      if (cell.segment == 0) continue;
      const double u = carrying::kCell * column + 0.5 * (carrying::kCell - 1),
                   v = carrying::kCell * row + 0.5 * (carrying::kCell - 1);
      const Eigen::Vector3d p =
          T_now_s * (camera_.back_project(u, v, cell.depth) + shifts[cell.segment - 1U]);
      if (p.z() < carrying::kNearest) continue;
      put(cell, p, moved);
    }
  }
  close_gaps(moved);
  return moved;
}

/// Between cells that move apart: that of the farthest of the neighbours, which the nearer ones
/// have uncovered.
void SegmentCarrier::close_gaps(std::vector<Cell>& grid) const {
  for (int pass = 0; pass < kGap; ++pass) {
    const std::vector<Cell> before = grid;
    for (int y = 1; y + 1 < rows_; ++y) {
      for (int x = 1; x + 1 < columns_; ++x) {
        const std::ptrdiff_t i = std::ptrdiff_t{y} * columns_ + x;
        Cell& cell = grid[static_cast<std::size_t>(i)];
        if (cell.segment != 0) continue;
        for (const std::ptrdiff_t step : {std::ptrdiff_t{-1}, std::ptrdiff_t{1},
                                          std::ptrdiff_t{-columns_}, std::ptrdiff_t{columns_}}) {
          const Cell& other = before[static_cast<std::size_t>(i + step)];
          if (other.segment != 0 && other.depth > cell.depth) cell = other;
        }
      }
    }
  }
}

/// Puts a cell at its point (m) in the camera of the other frame; it covers more of the grid when
/// it comes nearer.
void SegmentCarrier::put(const Cell& cell, const Eigen::Vector3d& p,
                         std::vector<Cell>& grid) const {
  const Eigen::Vector2d at = (camera_.project(p) + Eigen::Vector2d(0.5, 0.5)) / carrying::kCell;
  const double half = std::clamp(0.5 * cell.depth / p.z(), 0.5, kLargestSplat);
  if (!(at.x() + half >= 0 && at.y() + half >= 0 && at.x() - half < columns_ &&
        at.y() - half < rows_)) {
    return;
  }
  // Those whose centres it covers.
  const int first_x = std::max(0, static_cast<int>(std::ceil(at.x() - half - 0.5)));
  const int last_x = std::min(columns_ - 1, static_cast<int>(std::floor(at.x() + half - 0.5)));
  const int first_y = std::max(0, static_cast<int>(std::ceil(at.y() - half - 0.5)));
  const int last_y = std::min(rows_ - 1, static_cast<int>(std::floor(at.y() + half - 0.5)));
  for (int y = first_y; y <= last_y; ++y) {
    for (int x = first_x; x <= last_x; ++x) {
      Cell& there = grid[static_cast<std::size_t>(y * columns_ + x)];
      const auto depth = static_cast<float>(p.z());
      if (there.segment == 0 || depth < there.depth) there = {cell.segment, depth};
    }
  }
}

}  // namespace kys_slam
